"""Whether a motor must have turned, for a simulated joint with a sound or stuck encoder."""

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, floor, inf, pi, sin

import pytest

from aerarm_ros.hardware.boards.encoder_monitor import ExpectedMotion

COUNT = 2.0 * pi / 4096.0  # [rad] motor side
RATIO = 1.0 / 27.0
PER_AMPERE = 0.59  # [Nm/A]
STEP = 1e-4  # [s]
CYCLE = 1e-3  # [s]
LARGEST = 9.4  # [Nm]


@dataclass
class Joint:
    """A joint with dry friction, weight, something to lean on, and an encoder on its motor."""

    inertia: float = 0.3
    load: Callable[[float], float] = lambda time: 0.0
    coulomb: float = 0.1
    load_friction: float = 0.04
    stop: float = inf  # [rad] beyond which it meets a stiff spring
    stuck_at: float = inf  # [s]

    q: float = 0.0
    dq: float = 0.0
    time: float = 0.0
    reading: float = 0.0

    def begin(self) -> None:
        """Be at rest: a parameter is the same joint each time that its test runs."""
        self.q = self.dq = self.time = self.reading = 0.0

    def turn(self, torque: float) -> float:
        """Turn for a cycle; return the encoder's change [rad]."""
        for _ in range(round(CYCLE / STEP)):
            self.time += STEP
            push = -1e5 * (self.q - self.stop) - 100.0 * self.dq if self.q > self.stop else 0.0
            inertia, load = self.inertia, self.load(self.time)
            drive = torque - load + push
            most = self.coulomb + self.load_friction * abs(torque)
            free = self.dq + drive / inertia * STEP
            slowed = abs(free) - most / inertia * STEP
            self.dq = copysign(max(slowed, 0.0), free)
            self.q += self.dq * STEP
        return self.told()

    def told(self) -> float:
        """Return the encoder's change for the rotor's present angle [rad]."""
        last = self.reading
        if self.time < self.stuck_at:
            self.reading = floor(self.q / RATIO / COUNT) * COUNT
        return self.reading - last


@dataclass
class WornJoint(Joint):
    """A joint whose rotor turns alone within the gear's backlash, and hits stiff flanks."""

    rotor: float = 0.0095  # [kg m^2]
    play: float = 0.01  # [rad]

    link: float = 0.0
    dlink: float = 0.0

    def begin(self) -> None:
        super().begin()
        self.link = self.dlink = 0.0

    def turn(self, torque: float) -> float:
        for _ in range(round(CYCLE / STEP)):
            self.time += STEP
            ahead, closing = self.link - self.q, self.dlink - self.dq
            side, deep = copysign(1.0, ahead), abs(ahead) - 0.5 * self.play
            flank = max(2e4 * deep + 10.0 * side * closing, 0.0) * side if deep > 0.0 else 0.0
            most = (self.coulomb + self.load_friction * abs(flank)) / self.rotor * STEP
            free = self.dq + (torque + flank) / self.rotor * STEP
            self.dq = copysign(max(abs(free) - most, 0.0), free)
            pull = self.load(self.time) + flank
            self.dlink -= pull / (self.inertia - self.rotor) * STEP
            self.q += self.dq * STEP
            self.link += self.dlink * STEP
        return self.told()


def watch(joint: Joint, torque: Callable[[float, Joint], float], seconds: float = 1.0) -> float:
    """Return the time at which an undetected turn is found [s], inf if never."""
    joint.begin()
    motion = ExpectedMotion((1.5 * 4.7 + 0.4) / PER_AMPERE, LARGEST / PER_AMPERE, PER_AMPERE, RATIO)
    for _ in range(round(seconds / CYCLE)):
        asked = max(min(torque(joint.time, joint), LARGEST), -LARGEST)
        change = joint.turn(asked)
        current = asked / PER_AMPERE
        friction = 4.0 * 0.1 / PER_AMPERE + 0.2 * abs(current)
        if motion.update(change, CYCLE, current, 0.3 if joint.inertia > 0.1 else 0.01, friction):
            return joint.time
    return inf


def swinging(time: float, joint: Joint) -> float:
    return 6.0 * sin(9.0 * time)


HEALTHY = {
    'free': (Joint(), swinging),
    'light': (Joint(inertia=0.011), lambda time, joint: 0.3 * swinging(time, joint)),
    'carrying': (Joint(load=lambda time: 4.0), lambda time, joint: 4.0 + swinging(time, joint)),
    'heavier than known': (Joint(inertia=0.4, load=lambda time: 5.5), swinging),
    'much friction': (
        Joint(coulomb=0.19, load_friction=0.09, load=lambda time: 3.0),
        lambda time, joint: 3.0 + 0.2 * swinging(time, joint),
    ),
    'compensated at rest while the base turns': (
        Joint(load=lambda time: 4.7 * sin(2.0 * time)),
        lambda time, joint: 4.7 * sin(2.0 * time),
    ),
    'against its stop': (Joint(stop=0.1), lambda time, joint: min(10.0 * time, 2.0)),
    'led to and fro at its stop': (Joint(stop=0.02), lambda time, joint: 1.5 * sin(5.0 * time)),
    # Slow enough for looks without a count between those with one.
    'lifting a load slowly, and stopping': (
        Joint(load=lambda time: 4.6),
        lambda time, joint: 4.6 + 30.0 * (0.05 * (time < 0.2) - joint.dq),
    ),
    'with slack': (WornJoint(play=0.008), lambda time, joint: 0.8 * sin(6.0 * time)),
    'thrown from flank to flank': (
        WornJoint(play=0.05),
        lambda time, joint: 6.0 * sin(12.0 * time),
    ),
    'shaken in a worn gear': (
        WornJoint(load=lambda time: 3.0 * sin(12.0 * time)),
        lambda time, joint: -60.0 * joint.q - 6.0 * joint.dq,
    ),
    'resting on something': (
        Joint(load=lambda time: 4.0 if time < 0.3 else 0.0),
        lambda time, joint: 4.0 if time < 0.3 else 0.0,
    ),
    'braked as hard as it can be': (
        Joint(inertia=0.011),
        lambda time, joint: 9.4 if time % 0.1 < 0.004 else -15.0 * joint.dq,
    ),
    'damped with high gain': (
        Joint(load=lambda time: 5.0),
        lambda time, joint: 14.0 * (sin(3.0 * time) - joint.dq),
    ),
}


@pytest.mark.parametrize('name', HEALTHY)
def test_a_healthy_joint_moves_whenever_it_must(name: str) -> None:
    joint, torque = HEALTHY[name]
    assert watch(joint, torque) == inf


@pytest.mark.parametrize(
    ('joint', 'torque', 'within'),
    [
        (Joint(stuck_at=0.1), lambda time, joint: 3.0, 0.008),
        (
            Joint(stuck_at=0.1, load=lambda time: 4.0),
            lambda time, joint: 4.0 + (time > 0.05) * 4.0,
            0.015,
        ),
        (Joint(stuck_at=0.012, load=lambda time: 2.0), lambda time, joint: 9.4, 0.04),
        (Joint(stuck_at=0.0), lambda time, joint: 3.0 * (time > 0.1), 0.15),
        (Joint(stuck_at=0.1, inertia=0.011), lambda time, joint: 0.8 * (time > 0.05), 0.004),
        (Joint(stuck_at=0.0, inertia=0.011), lambda time, joint: 9.4 * (time > 0.05), 0.06),
        (Joint(stuck_at=0.1), lambda time, joint: 2.0 if time < 0.099 else 0.0, 0.02),
    ],
    ids=[
        'constant',
        'loaded',
        'saturated early',
        'from rest',
        'light',
        'light from rest',
        'coasting',
    ],
)
def test_one_that_is_stuck_is_found_before_it_is_far(joint, torque, within) -> None:
    stuck = max(joint.stuck_at, 0.0)
    found = watch(joint, torque)
    assert stuck < found <= stuck + within
    assert abs(joint.dq) < 5.0


def test_a_motor_at_its_limit_that_moves_nothing_for_long_is_found() -> None:
    # What is left beyond the load is less than what friction may take.
    joint = Joint(load=lambda time: 8.5, stuck_at=0.0)
    assert watch(joint, lambda time, joint: 9.4) == pytest.approx(0.101, abs=0.002)
    almost = Joint(load=lambda time: 8.0, coulomb=0.2)
    assert watch(almost, lambda time, joint: 8.2) == inf


def moving(speed: float, cycles: int = 40) -> ExpectedMotion:
    """Return a watch that has seen a motor turn at a joint speed [rad/s], without load."""
    motion = ExpectedMotion(12.0, 16.0, PER_AMPERE, RATIO)
    for _ in range(cycles):
        assert not motion.update(speed / RATIO * CYCLE, CYCLE, 0.0, 0.3, 0.7)
    return motion


def stands(motion: ExpectedMotion, looks: int, current: float = 0.0, **others: float) -> int | None:
    """Return the number of the look at which it must have turned, None if there is none."""
    for look in range(1, looks + 1):
        if motion.update(0.0, CYCLE, current, 0.3, 0.7, **others):
            return look
    return None


def test_speed_does_not_end_between_two_looks() -> None:
    assert stands(moving(5.0), 10) == 3  # a frame that comes twice is one
    assert stands(moving(1.0), 20) == pytest.approx(6, abs=1)
    assert stands(moving(0.12), 300) is None  # friction may stop it


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_torque_that_brakes_explains_a_stop_and_torque_that_drives_does_not(way: float) -> None:
    # The torque goes with the speed that it takes away.
    assert stands(moving(0.5 * way), 12, current=-14.0 * way) is None
    assert stands(moving(0.5 * way), 12, current=14.0 * way) is not None


def test_the_model_load_only_widens_the_load_range() -> None:
    def found(modelled: float) -> int | None:
        motion = moving(0.05)
        return stands(motion, 200, current=4.0, modelled=modelled)

    assert found(0.0) < 50
    assert found(1.0) > found(0.0)
    assert found(4.0) is found(-4.0) is None


def test_a_pause_discards_the_known_speed_but_not_a_standstill() -> None:
    motion = moving(2.0)
    motion.pause(0.5, 0.01, 0.0)
    assert stands(motion, 100) is None
    motion = moving(2.0)
    motion.pause(0.0, 0.01, 0.0)  # it may have come to rest
    assert stands(motion, 100) is None
    motion = moving(2.0)
    assert stands(motion, 2) is None
    motion.pause(0.0, 0.01, 0.0)
    assert stands(motion, 3) is not None


def test_after_a_pause_the_first_speed_does_not_change_the_load_estimate() -> None:
    motion = moving(2.0)
    motion.pause(0.5, 0.01, 0.0)
    motion.update(2.0 / RATIO * CYCLE, CYCLE, 0.0, 0.3, 0.7)
    motion.update(2.0 / RATIO * CYCLE, CYCLE, 0.0, 0.3, 0.7)
    motion.pause(0.01, 0.01, 0.0)  # it came to rest
    assert stands(motion, 100) is None


def test_restarted_it_takes_its_current_for_its_load() -> None:
    motion = moving(3.0)
    motion.restart()
    assert stands(motion, 200, current=14.0) is None
    motion.restart()
    assert stands(motion, 200, current=15.0) == pytest.approx(101, abs=1)  # but not what strains it
