"""Motions of a healthy arm whose host is delayed at random, in every mode of the bridge.

Every fault that the bridge reports here is false. No board may be switched off, and no joint may
be faster than in an attack. As a program, this module is a part of `make attacks`: it runs a
number of trials, prints one row per kind, and returns 1 if a trial failed.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import inf

import numpy as np
from attack_campaign import SPEED_MAX
from attack_rig import AttackRig, Offer, Source
from attack_world import ANSWER, EXCHANGE, READ, WAKE

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.parallel import run_in_order

POINTS = (WAKE, READ, f'{EXCHANGE} 0', f'{ANSWER} 0', f'{EXCHANGE} 1', f'{ANSWER} 1')
_MARGIN = 0.35  # [rad] margin of the motions to the position limits
_PACE = np.array([8.0, 2.2, 8.0, 8.0])  # [rad/s] of the fastest swings
# A position without its velocity lags by kd/kp times the velocity: joint 2 by 0.1 s.
_POSITION_SPEED = np.array([4.0, 1.5, 4.0, 4.0])  # [rad/s]
# Above this speed joint 2 lacks the torque to reverse a stretched arm within its limits.
_TRACKED_SPEED = np.array([5.0, 3.0, 5.0, 5.0])  # [rad/s]
_EFFORT_GAINS = np.array([6.0, 12.0, 1.0, 1.0]), np.array([1.5, 3.0, 0.15, 0.15])
_EFFORT_SPEED = 2.0  # [rad/s]


class RandomDelays:
    """Random delays of a host, at random cycles and points.

    Parameters
    ----------
    random
        Random generator.
    every
        Mean number of cycles between two delays.
    shortest, longest
        Their length [s].
    points
        Points of the cycle at which they happen, see `attack_world`.

    Attributes
    ----------
    count
        Number of delays so far.
    """

    def __init__(
        self,
        random: np.random.Generator,
        every: float = 25.0,
        shortest: float = 1e-3,
        longest: float = 15e-3,
        points: tuple[str, ...] = POINTS,
    ) -> None:
        self.count = 0
        self._random = random
        self._every = every
        self._bounds = shortest, longest
        self._points = points
        self._next = (0, points[0])
        self._draw(0)

    def __call__(self, cycle: int, point: str) -> float:
        """Return the host's delay at a point [s]."""
        due, where = self._next
        if cycle < due or point != where:
            return 0.0
        self.count += 1
        self._draw(cycle)
        return float(self._random.uniform(*self._bounds))

    def _draw(self, cycle: int) -> None:
        # Several in one cycle are possible, at different points.
        gap = int(self._random.exponential(self._every))
        self._next = cycle + gap, str(self._random.choice(self._points))


class WideSwing:
    """Swings of all joints over their range, at individual speeds up to the given one."""

    def __init__(self, random: np.random.Generator, speed_max: np.ndarray | float) -> None:
        config = load_arm_config()
        low = config.column('position_min') + _MARGIN
        high = config.column('position_max') - _MARGIN
        # Some joints rest, and some move at the limit.
        speed = speed_max * np.clip(random.uniform(-0.2, 1.1, 4), 0.0, 1.0)
        self._pace = np.maximum(_PACE * random.uniform(0.7, 1.0, 4), 2.01 * speed / (high - low))
        self._reach = speed / self._pace
        self._way = random.choice([-1.0, 1.0], 4)
        ahead = 2.0 * self._reach * self._way
        self.start = random.uniform(low - np.minimum(ahead, 0.0), high - np.maximum(ahead, 0.0))
        self._begin = inf

    def at(self, rig: AttackRig) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s]; the motion begins with the first call."""
        self._begin = min(self._begin, rig.now)
        phase = self._pace * (rig.now - self._begin)
        q = self.start + self._way * self._reach * (1.0 - np.cos(phase))
        return q, self._way * self._reach * self._pace * np.sin(phase)


Motion = tuple[np.ndarray, Source | None]


def velocity(random: np.random.Generator) -> Motion:
    """Velocities up to the limit."""
    swing = WideSwing(random, 5.0)
    return swing.start, lambda rig: Offer(velocity=swing.at(rig)[1])


def position(random: np.random.Generator) -> Motion:
    """Positions alone."""
    swing = WideSwing(random, _POSITION_SPEED)
    return swing.start, lambda rig: Offer(position=swing.at(rig)[0])


def full_law(random: np.random.Generator) -> Motion:
    """Positions with their velocities, and gravity as effort."""
    swing, dynamics = WideSwing(random, _TRACKED_SPEED), Dynamics(load_robot())
    return swing.start, lambda rig: Offer(*swing.at(rig), dynamics.gravity(rig.bridge.q))


def effort(random: np.random.Generator) -> Motion:
    """Efforts of a controller."""
    swing, dynamics = WideSwing(random, _EFFORT_SPEED), Dynamics(load_robot())
    kp, kd = _EFFORT_GAINS

    def source(rig: AttackRig) -> Offer:
        q, dq = swing.at(rig)
        feedback = kp * (q - rig.bridge.q) + kd * (dq - rig.bridge.dq)
        return Offer(effort=dynamics.gravity(rig.bridge.q) + feedback)

    return swing.start, source


def start_and_stop(random: np.random.Generator) -> Motion:
    """Velocities that step between directions, with rests in between."""
    swing, way = WideSwing(random, 0.0), random.choice([-1.0, 1.0], 4)
    speed = random.uniform(0.5, 4.0, 4) * [1.0, 0.5, 1.0, 1.0]

    def source(rig: AttackRig) -> Offer:
        step = int(rig.now / 0.12) % 4
        return Offer(velocity=(0.0, 1.0, 0.0, -1.0)[step] * way * speed)

    return np.clip(swing.start, -1.4, 2.0), source


def stopping_controller(random: np.random.Generator) -> Motion:
    """A controller that stops at speed and returns: followed, damped, followed."""
    start, source = velocity(random)
    return start, lambda rig: source(rig) if rig.now % 0.3 < 0.15 else None


def holding(random: np.random.Generator) -> Motion:
    """No commands: the bridge holds the arm in place."""
    return WideSwing(random, 0.0).start, None


def stopped(random: np.random.Generator) -> Motion:
    """An emergency stop at speed; the arm sinks, damped."""
    start, source = velocity(random)

    def until_stop(rig: AttackRig) -> Offer:
        if rig.cycles == 150:
            rig.bridge.e_stop('of the test')
        return source(rig)

    return start, until_stop


MOTIONS: dict[str, Callable[[np.random.Generator], Motion]] = {
    motion.__name__: motion
    for motion in (
        velocity,
        position,
        full_law,
        effort,
        start_and_stop,
        stopping_controller,
        holding,
        stopped,
    )
}


@dataclass(frozen=True)
class Trial:
    """Result of a trial.

    Attributes
    ----------
    motion, number
        Kind of motion and number of the arm.
    delays
        Number of delays of the host.
    faults
        Faults that the bridge reported, except an emergency stop; all are false.
    drops
        Number of frames that switched a board off.
    errors
        Error codes of the boards.
    speed
        Highest true speed of a joint, as a fraction of its limit.
    """

    motion: str
    number: int
    delays: int
    faults: tuple[str, ...]
    drops: int
    errors: tuple[int, ...]
    speed: float

    @property
    def is_clean(self) -> bool:
        """Return whether no part counted as faulty, was switched off or became too fast."""
        return not (self.faults or self.drops or any(self.errors) or self.speed > SPEED_MAX)


def run(motion: str, number: int, seconds: float = 1.0, **delays: object) -> Trial:
    """Delay the host of the arm of a number; for `delays` see `RandomDelays`."""
    config, robot = load_arm_config(), load_robot()
    random = np.random.default_rng([number, *motion.encode()])
    posture, source = MOTIONS[motion](random)
    script = RandomDelays(random, **delays)  # type: ignore[arg-type]
    payload = float(random.choice([0.0, 0.5, 1.0])) * config.rated_payload[0]
    seed = None if number % 3 == 0 else int(random.integers(1, 1000))
    made = {'posture': posture, 'payload': payload, 'seed': seed}
    rig = AttackRig(config, robot, delays=script, **made).bring_up()
    before = len(rig.frames.times(0))
    log = rig.run(seconds, source)
    told = np.stack([rig.frames.commands(board)['enable_system'][before:] for board in (0, 1)])
    return Trial(
        motion,
        number,
        script.count,
        tuple(fault for fault in log.faults if 'emergency' not in fault),
        int((~told).sum()),
        tuple(board.error for board in rig.boards.boards),
        float(log.speed_ratio(config).max()),
    )


def main() -> int:
    """Run trials of each motion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=10, help='of each motion')
    parser.add_argument('--first', type=int, default=0, help='number of the first')
    parser.add_argument('--only', nargs='*', default=list(MOTIONS))
    parser.add_argument('--longest', type=float, default=15e-3, help='hold-up [s]')
    parser.add_argument('--every', type=float, default=25.0, help='cycles')
    parser.add_argument('--processes', type=int, default=0)
    options = parser.parse_args()
    unclean = 0
    numbers = range(options.first, options.first + options.runs)
    trial_of = partial(run, longest=options.longest, every=options.every)
    runs = [(motion, number) for motion in options.only for number in numbers]
    results = run_in_order(trial_of, runs, options.processes)
    for motion in options.only:
        trials = list(islice(results, len(numbers)))
        bad = [trial for trial in trials if not trial.is_clean]
        unclean += len(bad)
        count, speed = sum(t.delays for t in trials), max(t.speed for t in trials)
        print(f'{motion:20}{count:6} hold-ups{speed:7.2f} of the speed limit', flush=True)
        for trial in bad:
            print(f'  {trial}', flush=True)
    print(f'{unclean} trials with a false fault, a drop or too much speed')
    return 1 if unclean else 0


if __name__ == '__main__':
    sys.exit(main())
