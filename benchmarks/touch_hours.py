"""Detection delay and false alarm rate of `ContactDetector`.

The arms of `payload_hours.py` work on the physics engine, with a model that has the errors of
identified models (links by 1 %, friction by 15 %). Thresholds are learned from a separate motion.
Friction drifts, and with `--payload` the arm picks up and puts down an undeclared payload. Touches
are forces on the tool and on the second link, with random directions and times.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from payload_hours import (
    CYCLE,
    KNOWN,
    MADE,
    PURSUIT,
    VELOCITY_LAG,
    WINDOW,
    Arm,
    Array,
    Plant,
    Work,
)

from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.contact_detector import (
    Cause,
    ContactDetector,
    ContactSettings,
    with_rest_share,
)
from aerarm_ros.online.external_torque import ExternalTorque, ResidualBound, Unexplained
from aerarm_ros.online.replay import KnownArm
from aerarm_ros.simulation.arm_plant import PlantParameters

GAIN = 60.0  # [1/s]
LEARNING = 60.0  # [s] of motion without contact
HOLD, PAUSE = 0.5, 3.0  # [s] duration of a touch, and shortest time between two
DRIFT = 0.15  # relative change of friction over DRIFT_TIME
DRIFT_TIME = 300.0  # [s]
PAYLOAD_TIME = 30.0  # [s] between changes of payload
FORCES = {'tool': 2.0, 'link 2': 4.0}  # [N] on the packaged arm


class TouchedPlant(Plant):
    """Arm with an external force on one of its links."""

    def touch(self, body: int, point: Array, force: Array) -> None:
        """Apply a force [N] at a point of a body's frame [m] from now on; both in world axes."""
        self._data.xfrc_applied[:] = 0.0
        arm = self._data.xpos[body] + self._data.xmat[body].reshape(3, 3) @ point
        moment = np.cross(arm - self._data.xipos[body], force)
        self._data.xfrc_applied[body] = [*force, *moment]

    def bodies(self) -> int:
        """Return the number of bodies in the model."""
        return int(self._model.nbody)

    def end_of(self, body: int) -> Array:
        """Return the attachment point (3,) of a body's child, in the body's frame [m]."""
        children = [c for c in range(self._model.nbody) if self._model.body_parentid[c] == body]
        return np.array(self._model.body_pos[children[0]]) if children else np.array([0.1, 0, 0])


class Job(NamedTuple):
    """Settings of one session."""

    joints: int
    seed: int
    seconds: float
    touches: bool
    payload: bool


@dataclass
class Session:
    """Delays [s] of touches by place (NaN: missed), the torque of each, and false contacts."""

    job: Job
    delays: dict[str, list[float]] = field(default_factory=dict)
    false: list[float] = field(default_factory=list)
    payloads: int = 0
    early: int = 0  # contacts reported while a payload changed


class Rig:
    """Simulated arm under position control."""

    def __init__(self, arm: Arm, truth: PlantParameters, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self._work = Work(arm.robot, self.random)
        self.plant = TouchedPlant(arm.robot, truth, self._work.start)
        self._moves = self._work.play()
        self._truth, self._noise = truth, arm.noise
        self._model = Dynamics(
            arm.robot.with_inertial_parameters(truth.inertial_parameters), truth.rotor_inertia
        )
        self._stiffness = PURSUIT**2 * np.diag(self._model.inertia_matrix(self._work.start))
        self._speed = np.zeros(arm.robot.n)

    def window(self) -> ArmState:
        """Advance by one window and return the state at its end."""
        mean = np.zeros(len(self._speed))
        share = -np.expm1(-CYCLE / VELOCITY_LAG)
        for _ in range(WINDOW):
            q, dq, ddq = next(self._moves)
            friction = self._truth.viscous * dq + self._truth.coulomb * np.tanh(dq / 0.02)
            tau = self._model.inverse(q, dq, ddq) + friction
            tau += self._stiffness * (q - self.plant.position)
            tau += 2.0 * self._stiffness / PURSUIT * (dq - self.plant.velocity)
            self.plant.cycle(tau)
            self._speed += share * (self.plant.velocity - self._speed)
            mean += (tau + self._noise * self.random.standard_normal(len(tau))) / WINDOW
        return ArmState(self.plant.position, self._speed.copy(), mean)


def session(job: Job) -> Session:
    """Learn thresholds, then run the session."""
    arm = Arm.of(job.joints)
    truth = arm.drawn.perturbed(job.seed, MADE)
    known = truth.perturbed(10_000 + job.seed, KNOWN)
    robot = arm.robot.with_inertial_parameters(known.inertial_parameters)
    friction = np.array([known.viscous, known.coulomb, known.load_friction])
    model = KnownArm(robot, known.rotor_inertia, friction)
    rig, dt = Rig(arm, truth, job.seed), WINDOW * CYCLE
    external, rows = ExternalTorque(model, GAIN), list[Unexplained]()
    states: list[tuple[float, ArmState]] = []
    for number in range(round(LEARNING / dt)):
        states.append((number * dt, rig.window()))
        row = external.update(states[-1][1], dt)
        if number * dt > 0.5:
            rows.append(row)
    settings = ContactSettings(0.01, payload_mass=arm.mass, payload_size=0.15)
    bound = with_rest_share(
        ResidualBound.learnt(rows, GAIN),
        lambda: ExternalTorque(model, GAIN),
        lambda: states,
        settings,
    )
    found = ContactDetector(ExternalTorque(model, GAIN), bound, settings)
    return work(job, rig, found, truth, arm)


def work(job: Job, rig: Rig, found: ContactDetector, truth: PlantParameters, arm: Arm) -> Session:
    """Play the session and compare detected with applied touches."""
    result, dt, n = Session(job), WINDOW * CYCLE, arm.robot.n
    loaded = truth.carrying(arm.mass, (0.06, 0.01, -0.02), 0.03)
    places = {'tool': rig.plant.bodies() - 1, 'link 2': rig.plant.bodies() - n + 1}
    due, until, name, force = 5.0, -1.0, '', np.zeros(3)
    carries, changed, seen = False, -np.inf, 0
    for number in range(round(job.seconds / dt)):
        now = number * dt
        if number % 200 == 0:
            drift = 1.0 + DRIFT * np.sin(2.0 * np.pi * now / DRIFT_TIME)
            rig.plant.scale_friction([drift] * n)
        if job.payload and now - max(changed, 0.0) > PAYLOAD_TIME:
            carries, changed = not carries, now
            rig.plant.grasp(loaded if carries else truth)
        if job.touches and now >= due and found.event is None:
            name = list(places)[int(rig.random.integers(len(places)))]
            direction = rig.random.standard_normal(3)
            force = FORCES[name] * direction / np.linalg.norm(direction)
            until, due = now + HOLD, now + HOLD + PAUSE + rig.random.uniform(0.0, 2.0)
            result.delays.setdefault(name, []).append(np.nan)
        body = places.get(name, 0)
        touching = now < until
        rig.plant.touch(body, rig.plant.end_of(body), force if touching else np.zeros(3))
        found.update(rig.window(), now)
        for event in found.events[seen:]:
            if now < until + 0.1:
                if np.isnan(result.delays[name][-1]):
                    result.delays[name][-1] = now + dt - (until - HOLD)
            elif now - changed < 10.0:
                result.early += event.cause is Cause.CONTACT
            elif event.cause is Cause.CONTACT:
                result.false.append(round(now, 2))
        seen = len(found.events)
    result.payloads = sum(event.cause is Cause.PAYLOAD for event in found.events)
    return result


def main() -> int:
    """Run the sessions and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=0.05, help='hours per number of joints')
    parser.add_argument('--joints', type=int, nargs='+', default=[4], choices=[4, 5, 6, 7])
    parser.add_argument('--seconds', type=float, default=300.0, help='duration of a session')
    parser.add_argument('--touches', action='store_true', help='touch the arm')
    parser.add_argument('--payload', action='store_true', help='change the payload')
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    options = parser.parse_args()
    runs = max(round(3600.0 * options.hours / options.seconds), 1)
    jobs = [
        Job(n, seed, options.seconds, options.touches, options.payload)
        for seed in range(runs)
        for n in options.joints
    ]
    with ProcessPoolExecutor(options.jobs) as pool:
        results = list(pool.map(session, jobs))
    for result in results:
        print(result, flush=True)
    for joints in options.joints:
        report(joints, [result for result in results if result.job.joints == joints])
    return 0


def report(joints: int, results: list[Session]) -> None:
    """Print one line per number of joints, and one per touched place."""
    hours = sum(result.job.seconds for result in results) / 3600.0
    false = sum(len(result.false) for result in results)
    payloads, early = (sum(getattr(r, key) for r in results) for key in ('payloads', 'early'))
    print(f'{joints} joints: {false} false contacts in {hours:.2f} h; {payloads} payloads '
          f'reported, {early} contacts within 10 s of a change of payload')  # fmt: skip
    for place, force in FORCES.items():
        delays = np.array([d for r in results for d in r.delays.get(place, [])])
        if len(delays):
            in_time = int(np.sum(delays <= 0.05))
            print(f'  {force:g} N at the {place}: {in_time} of {len(delays)} within 50 ms, '
                  f'{int(np.isfinite(delays).sum())} found, median '
                  f'{1e3 * np.median(np.nan_to_num(delays, nan=HOLD)):.0f} ms')  # fmt: skip


if __name__ == '__main__':
    sys.exit(main())
