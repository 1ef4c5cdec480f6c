"""Detection rate, position error and false alarm rate of `ContactDetector`.

Emulated arms work for hours on the physics engine: random waves, moves between random postures,
and rests. The identifier identifies each arm from a bag of 60 s of free motion, from which the
thresholds are learnt too. Dry friction of each joint drifts. With `--touches`, forces in random
directions act on the tool and on the end of the second link at random times. Without `--touches`,
the arm picks up or puts down a payload every 60 s. Every second session declares the change to the
detector at most 0.25 s before it; any event is then a false alarm. In the other sessions the
payload is undeclared, and contacts that begin within 10 s of a change do not count. Reports of a
model error are counted separately.
"""

import argparse
import sys
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from payload_hours import CYCLE, Array
from touching.touched_arm import Learnt, TouchedArm, learn, made

from aerarm_ros.online.contact_detector import Cause, ContactDetector
from aerarm_ros.online.contact_place import ContactLocator, ContactPlace
from aerarm_ros.online.information_filter import ball
from aerarm_ros.parallel import run_in_order
from aerarm_ros.simulation.arm_plant import PlantParameters

GAIN = 60.0  # [1/s]
WINDOW = 5  # cycles with one feed-forward of the arm's controller
HOLD, PAUSE = 0.5, 3.0  # [s] duration of a touch, and shortest time between two
DRIFT, DRIFT_TIME = 0.15, 300.0  # relative change of dry friction, and its period [s]
PAYLOAD_TIME = 60.0  # [s] between changes of payload
PAYLOAD = (0.06, 0.01, -0.02), 0.03  # [m] centre and radius of the payload
DECLARED = 0.25  # [s] largest time from a declaration to its change
SETTLING = 10.0  # [s] in which an undeclared payload counts as a contact
FORCES = {'tool': 2.0, 'link 2': 4.0}  # [N] on the packaged arm
SLOW = 0.05  # [rad/s]
IN_TIME = 0.05  # [s]
REPORTED = 0.3  # [s] after the touch, at which its place is compared


class Job(NamedTuple):
    """Settings of one session."""

    joints: int
    seed: int
    seconds: float
    touches: bool
    declared: bool


class Touch(NamedTuple):
    """Result of one contact.

    Attributes
    ----------
    delay : float
        Time until the detection [s], NaN if missed.
    moves : bool
        Whether a joint was faster than SLOW.
    share : float
        Largest joint torque relative to the friction that can balance it: 2 times the dry friction
        of a slow joint, which may act in either direction, and the drift of that of a moving joint.
        Below 1, dry friction or its drift explains the torque in every joint.
    link : float
        Index of the located link minus that of the touched link; NaN without a location.
    off : float
        Distance of the located from the touched point [m] on the right link.
    force : float
        Error of the estimated force [N], NaN if the posture does not determine the force.
    """

    place: str
    delay: float
    moves: bool
    share: float
    link: float = np.nan
    off: float = np.nan
    force: float = np.nan


@dataclass
class Session:
    """Contacts and detected events of a session."""

    job: Job
    touches: list[Touch] = field(default_factory=list)
    false: list[float] = field(default_factory=list)  # [s] times of false alarms
    changes: int = 0  # changes of payload
    recognized: list[float] = field(default_factory=list)  # [s] after a change
    contacts: int = 0  # contacts reported within SETTLING of a change
    errors: int = 0  # reports of a model error


def session(job: Job) -> Session:
    """Run a session: identify an arm, learn its thresholds, then move it."""
    arm, truth = made(job.joints, job.seed)
    learnt = learn(arm, truth, job.seed, GAIN)
    rig = TouchedArm(arm, truth, 1_000_000 + job.seed)
    random = np.random.default_rng(2_000_000 + job.seed)
    if job.touches:
        return touched(job, rig, learnt, random)
    carried = (truth, truth.carrying(arm.mass, *PAYLOAD))
    return free(job, rig, learnt, carried, arm.mass, random)


def drift(rig: TouchedArm, now: float, joints: int) -> None:
    """Change the dry friction of the joints slowly, with a different phase per joint."""
    phase = 2.0 * np.pi * (now / DRIFT_TIME + np.arange(joints) / joints)
    rig.plant.scale_friction((1.0 + DRIFT * np.sin(phase)).tolist())


def touched(job: Job, rig: TouchedArm, learnt: Learnt, random: np.random.Generator) -> Session:
    """Move the arm, with contact forces at random times."""
    result, found = Session(job), ContactDetector(learnt.external(), learnt.bound, learnt.settings)
    plant, n, locator = rig.plant, job.joints, ContactLocator(learnt.model.robot)
    places = {'tool': plant.bodies - 1, 'link 2': plant.bodies - n + 1}
    due, until, seen, now = 5.0, -1.0, 0, 0.0
    # Touches shall begin anywhere in the windows of the detector.
    skipped = int(random.integers(WINDOW))
    body, force, report = 0, np.zeros(3), None
    for number in range(round(job.seconds / CYCLE / WINDOW)):
        begin = number * WINDOW * CYCLE
        if number % 200 == 0:
            drift(rig, begin, n)
        if begin >= due and found.event is None:
            name = list(places)[int(random.integers(len(places)))]
            body, direction = places[name], random.standard_normal(3)
            force = FORCES[name] * direction / np.linalg.norm(direction)
            until, due = begin + HOLD, begin + HOLD + PAUSE + random.uniform(0.0, 2.0)
            result.touches.append(felt(name, rig, body, force))
        touching = begin < until
        plant.touch(body, plant.end_of(body), force if touching else np.zeros(3))
        event = found.event
        if abs(begin - until + HOLD - REPORTED) < 0.5 * CYCLE and event and report:
            change = report.torque - event.reference
            place = locator.locate(plant.position, change, event.threshold)
            links = learnt.model.robot.link_names
            result.touches[-1] = located(result.touches[-1], place, links, rig, body, force)
        for state in rig.cycles(WINDOW):
            now += CYCLE
            if skipped > 0:
                skipped -= 1
                continue
            report = found.update(state, now)
            new, seen = found.events[seen:], len(found.events)
            if new and begin < until + 0.1:
                if np.isnan(result.touches[-1].delay):
                    delay = now - (until - HOLD)
                    result.touches[-1] = result.touches[-1]._replace(delay=delay)
                continue
            result.false += [round(now, 2) for event in new if event.cause is Cause.CONTACT]
    return result


def located(
    touch: Touch, place: ContactPlace | None, links: tuple[str, ...], rig: TouchedArm, body: int,
    force: Array,
) -> Touch:  # fmt: skip
    """Return a contact with the errors of its estimated location."""
    if place is None:
        return touch
    # Bodies are the world and the moving links.
    link = links.index(place.link) - (body - 1)
    off = float(np.linalg.norm(place.point - rig.plant.end_of(body))) if link == 0 else np.nan
    error = float(np.linalg.norm(place.force - force)) if place.is_determined else np.nan
    return touch._replace(link=link, off=off, force=error)


def felt(name: str, rig: TouchedArm, body: int, force: Array) -> Touch:
    """Begin a contact; return it with the joint torques relative to friction."""
    torque = rig.plant.torque(body, rig.plant.end_of(body), force)
    speed = np.abs(rig.plant.velocity)
    band = np.where(speed < SLOW, 2.0, 2.0 * DRIFT) * rig.plant.dry_friction
    share = float((np.abs(torque) / band).max())
    return Touch(name, np.nan, bool(speed.max() > SLOW), share)


def free(
    job: Job,
    rig: TouchedArm,
    learnt: Learnt,
    carried: tuple[PlantParameters, PlantParameters],
    mass: float,
    random: np.random.Generator,
) -> Session:
    """Move the arm without contacts, with changes of payload."""
    result, found = Session(job), ContactDetector(learnt.external(), learnt.bound, learnt.settings)
    now, changes, told = 0.0, list[float](), 0
    early = random.uniform(0.0, DECLARED)
    for number in range(round(job.seconds / CYCLE / WINDOW)):
        begin = number * WINDOW * CYCLE
        if number % 200 == 0:
            drift(rig, begin, job.joints)
        if begin > (len(changes) + 1) * PAYLOAD_TIME:
            changes.append(begin)
            rig.plant.grasp(carried[len(changes) % 2])
        if job.declared and begin > (told + 1) * PAYLOAD_TIME - early:
            told += 1
            found.carry(ball(mass * (told % 2), *PAYLOAD))
            early = random.uniform(0.0, DECLARED)
        for state in rig.cycles(WINDOW):
            now += CYCLE
            found.update(state, now)
    result.changes = len(changes)
    for event in found.events:
        since = min((event.begin - time for time in changes if time < event.begin), default=1e9)
        if job.declared:
            result.false.append(round(event.begin, 2))
        elif event.cause in (Cause.PAYLOAD, Cause.RELEASED):
            result.recognized.append(event.end - event.begin + since)
        elif event.cause is Cause.MODEL:
            result.errors += 1
        elif since < SETTLING:
            result.contacts += 1
        else:
            result.false.append(round(event.begin, 2))
    return result


def main() -> int:
    """Run the sessions and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        '--hours', type=float, default=0.1, help='simulated hours per number of joints'
    )
    parser.add_argument('--joints', type=int, nargs='+', default=[4], choices=[4, 5, 6, 7])
    parser.add_argument('--seconds', type=float, default=300.0, help='duration of a session [s]')
    parser.add_argument('--touches', action='store_true', help='apply contact forces to the arm')
    parser.add_argument('--seed', type=int, default=0, help='seed of the first session')
    parser.add_argument('--jobs', type=int, default=1, help='number of processes')
    options = parser.parse_args()
    runs = max(round(3600.0 * options.hours / options.seconds), 1)
    jobs = [
        Job(n, seed, options.seconds, options.touches, seed % 2 == 1)
        for seed in range(options.seed, options.seed + runs)
        for n in options.joints
    ]
    results = []
    for result in run_in_order(session, [(job,) for job in jobs], options.jobs):
        results.append(result)
        print(summary(result), flush=True)
    for joints in options.joints:
        report(joints, [result for result in results if result.job.joints == joints])
    return 0


def summary(result: Session) -> str:
    """Return one line about a session."""
    job = result.job
    found = sum(touch.delay <= IN_TIME + 1e-6 for touch in result.touches)
    return (
        f'{job.joints} joints, seed {job.seed}, {job.seconds:g} s'
        f'{", payload declared" if job.declared else ""}: false alarms {result.false}, '
        f'model errors {result.errors}, touches {found} of {len(result.touches)} in time, payload '
        f'changes {result.changes}, recognized {np.round(result.recognized, 1).tolist()}'
    )


def wilson(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate (Wilson 1927)."""
    z, share = 1.96, count / total
    middle = (share + z**2 / (2.0 * total)) / (1.0 + z**2 / total)
    half = z / (1.0 + z**2 / total)
    half *= np.sqrt(share * (1.0 - share) / total + z**2 / (4.0 * total**2))
    return middle - half, middle + half


def report(joints: int, results: list[Session]) -> None:
    """Print the rates of all sessions with a number of joints."""
    hours = sum(result.job.seconds for result in results) / 3600.0
    false, errors, contacts, changes = (
        sum(np.size(getattr(result, name)) if name == 'false' else getattr(result, name)
            for result in results)
        for name in ('false', 'errors', 'contacts', 'changes')
    )  # fmt: skip
    print(f'{joints} joints: {false} false alarms and {errors} model errors in {hours:.2f} h')
    if changes:
        delays = [delay for result in results for delay in result.recognized]
        print(
            f'  {changes} changes of payload: {len(delays)} recognized; {contacts} contacts within '
            f'{SETTLING:g} s of a change'
        )
        if delays:
            print(f'    after {np.median(delays):.1f} s (median), {max(delays):.1f} s (largest)')
    touches = [touch for result in results for touch in result.touches]
    for place, force in FORCES.items():
        here = [touch for touch in touches if touch.place == place]
        for name, chosen in (
            ('all', here),
            ('friction does not explain the torque', [t for t in here if t.share > 1.0]),
            ('a joint moves', [t for t in here if t.moves]),
            ('all joints rest', [t for t in here if not t.moves]),
        ):
            if chosen:
                line(f'{force:g} N at the {place}, {name}', chosen)


def line(name: str, touches: list[Touch]) -> None:
    """Print the detection rate and the position error of a group of contacts."""
    delays = np.array([touch.delay for touch in touches])
    in_time = int(np.sum(delays <= IN_TIME + 1e-6))
    low, high = wilson(in_time, len(delays))
    print(
        f'  {name}: {in_time} of {len(delays)} within 50 ms, {100.0 * in_time / len(delays):.1f} % '
        f'({100.0 * low:.1f} to {100.0 * high:.1f} %); {int(np.isfinite(delays).sum())} found, '
        f'median {1e3 * np.nanmedian(delays):.0f} ms'
    )
    links, off, force = (
        np.array([getattr(t, key) for t in touches]) for key in ('link', 'off', 'force')
    )
    known = int(np.isfinite(links).sum())
    if known and np.isfinite(off).any():
        print(
            f'    link right in {int((links == 0).sum())} of {known}, previous link in '
            f'{int((links == -1).sum())}; median point error {1e3 * np.nanmedian(off):.0f} mm on '
            f'the right link; force determined in {int(np.isfinite(force).sum())}'
        )
        if np.isfinite(force).any():
            print(f'    median force error {np.nanmedian(force):.2f} N where determined')


if __name__ == '__main__':
    sys.exit(main())
