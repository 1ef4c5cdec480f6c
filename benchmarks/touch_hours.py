"""Detection delay and false alarm rate of `ContactDetector`.

Made arms work for hours on the physics engine: random waves, moves between random postures, and
rests. Model and thresholds of each come from a bag of 60 s of its own motion, through the
identifier. With `--touches`, forces of random direction act on the tool and on the end of the
second link at random times. Without, dry friction drifts, and the arm picks something up and puts
it down every 30 s: every second time the detector is given the payload, as by a controller's
parameter, and otherwise it has to recognize it.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from payload_hours import CYCLE, Arm
from touching.touched_arm import Learnt, TouchedArm, TouchedPlant, learn, made

from aerarm_ros.online.contact_detector import Cause, ContactDetector
from aerarm_ros.online.contact_place import ContactLocator
from aerarm_ros.simulation.arm_plant import PlantParameters

GAIN = 60.0  # [1/s]
WINDOW = 5  # cycles with one feed-forward of the arm's controller
HOLD, PAUSE = 0.5, 3.0  # [s] of a touch, and at least between two
DRIFT, DRIFT_TIME = 0.15, 300.0  # of dry friction, and its period [s]
PAYLOAD_TIME = 30.0  # [s] between changes of payload
SETTLING = 10.0  # [s] in which an undeclared payload has to be recognized
FORCES = {'tool': 2.0, 'link 2': 4.0}  # [N] on the packaged arm
SLOW = 0.05  # [rad/s] below which dry friction may point either way
IN_TIME = 0.05  # [s]

Array = np.ndarray


class Job(NamedTuple):
    """Settings of one session."""

    joints: int
    seed: int
    seconds: float
    touches: bool


class Touch(NamedTuple):
    """One touch: place, delay [s] (NaN if missed) and whether the joints could feel it.

    The torque on a joint [Nm] that moves is felt in full. Of a joint that is slow, dry friction
    takes up to what it can hold in either direction: a force of which every joint feels less than
    its friction band leaves the drives' torque as it was. `link` is the located link less the
    touched one, NaN if the touch was missed, and `off` the distance [m] of the point along it.
    """

    place: str
    delay: float
    moves: bool
    share: float
    link: float = np.nan
    off: float = np.nan


@dataclass
class Session:
    """What was found in a session, and what in error."""

    job: Job
    touches: list[Touch] = field(default_factory=list)
    false: list[float] = field(default_factory=list)
    undeclared: int = 0  # changes of payload that were not declared
    recognized: list[float] = field(default_factory=list)  # [s] after such a change
    contacts: int = 0  # reported until then
    errors: int = 0  # reports of a model error


def session(job: Job) -> Session:
    """Identify one arm, learn its thresholds, then work."""
    arm, truth = made(job.joints, job.seed)
    learnt = learn(arm, truth, job.seed, GAIN)
    rig = TouchedArm(arm, truth, 1_000_000 + job.seed)
    random = np.random.default_rng(2_000_000 + job.seed)
    if job.touches:
        return touched(job, rig, learnt, random)
    return free(job, rig, learnt, truth, arm, random)


def drift(rig: TouchedArm, now: float, phase: Array) -> None:
    """Let dry friction drift, each joint's on its own."""
    rig.plant.scale_friction(
        (1.0 + DRIFT * np.sin(2.0 * np.pi * now / DRIFT_TIME + phase)).tolist()
    )


def touched(job: Job, rig: TouchedArm, learnt: Learnt, random: np.random.Generator) -> Session:
    """Touch the arm now and then."""
    result, found = Session(job), ContactDetector(learnt.external(), learnt.bound, learnt.settings)
    plant, n, locator = rig.plant, job.joints, ContactLocator(learnt.model.robot)
    places = {'tool': plant.bodies - 1, 'link 2': plant.bodies - n + 1}
    phase = random.uniform(0.0, 2.0 * np.pi, n)
    due, until, seen, now = 5.0, -1.0, 0, 0.0
    # Touches shall begin anywhere in the windows of the detector.
    skipped = int(random.integers(WINDOW))
    body, force, touch = 0, np.zeros(3), Touch('', np.nan, False, 0.0)
    for number in range(round(job.seconds / CYCLE / WINDOW)):
        begin = number * WINDOW * CYCLE
        if number % 200 == 0:
            drift(rig, begin, phase)
        if begin >= due and found.event is None:
            name = list(places)[int(random.integers(len(places)))]
            body, direction = places[name], random.standard_normal(3)
            force = FORCES[name] * direction / np.linalg.norm(direction)
            until, due = begin + HOLD, begin + HOLD + PAUSE + random.uniform(0.0, 2.0)
            touch = felt(name, rig, learnt, body, force)
            result.touches.append(touch)
        elif until < begin < until + 2.0 * WINDOW * CYCLE:
            plant.touch(0, np.zeros(3), np.zeros(3))
            if np.isfinite(touch.delay) and np.isnan(touch.link):
                touch = result.touches[-1] = located(touch, found, locator, plant, body)
        if begin < until:
            plant.touch(body, plant.end_of(body), force)
        for state in rig.cycles(WINDOW):
            now += CYCLE
            if skipped > 0:
                skipped -= 1
                continue
            found.update(state, now)
            new, seen = found.events[seen:], len(found.events)
            if new and begin < until + 0.1:
                if np.isnan(touch.delay):
                    touch = result.touches[-1] = touch._replace(delay=now - (until - HOLD))
                continue
            result.false += [round(now, 2) for event in new if event.cause is Cause.CONTACT]
    return result


def located(
    touch: Touch, found: ContactDetector, locator: ContactLocator, plant: TouchedPlant, body: int
) -> Touch:
    """Return a touch with the place that the detector's last event gives it."""
    event = found.events[-1]
    place = locator.locate(event.q, event.torque, event.threshold)
    if place is None:
        return touch
    # Bodies are the world and the moving links.
    link = locator.links.index(place.link) - (body - 1)
    off = float(np.linalg.norm(place.point - plant.end_of(body))) if link == 0 else np.nan
    return touch._replace(link=link, off=off)


def felt(name: str, rig: TouchedArm, learnt: Learnt, body: int, force: Array) -> Touch:
    """Return a touch that begins, with the torque on the joints over what hides it."""
    torque = rig.plant.torque(body, rig.plant.end_of(body), force)
    speed = np.abs(rig.plant.velocity)
    band = np.where(speed < SLOW, 2.0, 0.3) * rig.plant.dry_friction
    share = float((np.abs(torque) / band).max())
    return Touch(name, np.nan, bool(speed.max() > SLOW), share)


def free(
    job: Job,
    rig: TouchedArm,
    learnt: Learnt,
    truth: PlantParameters,
    arm: Arm,
    random: np.random.Generator,
) -> Session:
    """Work without touches, with changes of payload."""
    found = ContactDetector(learnt.external(), learnt.bound, learnt.settings)
    loaded = truth.carrying(arm.mass, (0.06, 0.01, -0.02), 0.03)
    payload = (loaded.inertial_parameters - truth.inertial_parameters)[-1]
    phase = random.uniform(0.0, 2.0 * np.pi, job.joints)
    changes, now, undeclared = 0, 0.0, list[float]()
    for number in range(round(job.seconds / CYCLE / WINDOW)):
        begin = number * WINDOW * CYCLE
        if number % 200 == 0:
            drift(rig, begin, phase)
        if begin > (changes + 1) * PAYLOAD_TIME:
            changes += 1
            rig.plant.grasp(loaded if changes % 2 else truth)
            if changes % 4 in (1, 2):  # picked up and put down with a declaration
                found.carry(payload if changes % 2 else 0.0 * payload)
            else:
                undeclared.append(begin)
        for state in rig.cycles(WINDOW):
            now += CYCLE
            found.update(state, now)
    return judged(Session(job), found, undeclared)


def judged(result: Session, found: ContactDetector, undeclared: list[float]) -> Session:
    """Compare the events of a session without touches with its undeclared payloads."""
    result.undeclared = len(undeclared)
    for event in found.events:
        since = min((event.begin - time for time in undeclared if time < event.begin), default=1e9)
        if since < SETTLING:
            result.contacts += 1
            if event.cause in (Cause.PAYLOAD, Cause.RELEASED):
                result.recognized.append(event.end - event.begin + since)
        elif event.cause is Cause.MODEL:
            result.errors += 1
        elif event.cause is Cause.CONTACT:
            result.false.append(round(event.begin, 2))
    return result


def main() -> int:
    """Run the sessions and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=0.1, help='hours per number of joints')
    parser.add_argument('--joints', type=int, nargs='+', default=[4], choices=[4, 5, 6, 7])
    parser.add_argument('--seconds', type=float, default=600.0, help='of a session')
    parser.add_argument('--touches', action='store_true', help='touch the arm')
    parser.add_argument('--seed', type=int, default=0, help='of the first session')
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    options = parser.parse_args()
    runs = max(round(3600.0 * options.hours / options.seconds), 1)
    jobs = [
        Job(n, seed, options.seconds, options.touches)
        for seed in range(options.seed, options.seed + runs)
        for n in options.joints
    ]
    results = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(session, jobs):
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
        f'{job.joints} joints, seed {job.seed}, {job.seconds:g} s: false {result.false}, model '
        f'errors {result.errors}, touches {found} of {len(result.touches)} in time, undeclared '
        f'{result.undeclared}, recognized {np.round(result.recognized, 1).tolist()}'
    )


def wilson(count: int, total: int) -> tuple[float, float]:
    """Return the interval of 95 % of a rate (Wilson 1927)."""
    z, share = 1.96, count / total
    middle = (share + z**2 / (2.0 * total)) / (1.0 + z**2 / total)
    half = z / (1.0 + z**2 / total)
    half *= np.sqrt(share * (1.0 - share) / total + z**2 / (4.0 * total**2))
    return middle - half, middle + half


def report(joints: int, results: list[Session]) -> None:
    """Print the rates of one number of joints."""
    hours = sum(result.job.seconds for result in results) / 3600.0
    false = sum(len(result.false) for result in results)
    bound = (
        f'below {3.0 / hours:.2g} per hour (95 %)' if not false else f'{false / hours:.2g} per hour'
    )
    print(f'{joints} joints: {false} false contacts in {hours:.2f} h, {bound}')
    undeclared = sum(result.undeclared for result in results)
    if undeclared:
        recognized = [delay for result in results for delay in result.recognized]
        print(
            f'  {undeclared} undeclared changes of payload: {len(recognized)} recognized, '
            f'after {np.median(recognized):.1f} s in the median, {max(recognized):.1f} s at most; '
            f'{sum(r.contacts for r in results)} events within {SETTLING:g} s of them; '
            f'{sum(r.errors for r in results)} model errors'
        )
    touches = [touch for result in results for touch in result.touches]
    for place, force in FORCES.items():
        here = [touch for touch in touches if touch.place == place]
        for name, chosen in (
            ('all', here),
            ('some joint moves', [t for t in here if t.moves]),
            ('and the joints feel it', [t for t in here if t.moves and t.share > 1.0]),
            ('at rest', [t for t in here if not t.moves]),
        ):
            if chosen:
                line(f'{force:g} N at the {place}, {name}', chosen)


def line(name: str, touches: list[Touch]) -> None:
    """Print the rate of some touches."""
    delays = np.array([touch.delay for touch in touches])
    in_time = int(np.sum(delays <= IN_TIME + 1e-6))
    low, high = wilson(in_time, len(delays))
    print(
        f'  {name}: {in_time} of {len(delays)} within 50 ms, {100.0 * in_time / len(delays):.1f} % '
        f'({100.0 * low:.1f} to {100.0 * high:.1f}); {int(np.isfinite(delays).sum())} found, '
        f'median {1e3 * np.nanmedian(delays):.0f} ms'
    )
    links = np.array([touch.link for touch in touches])
    known, off = int(np.isfinite(links).sum()), np.array([touch.off for touch in touches])
    if known:
        print(
            f'    link right in {int((links == 0).sum())} of {known}, one before it in '
            f'{int((links == -1).sum())}; point off by {1e3 * np.nanmedian(off):.0f} mm in the '
            'median where the link is right'
        )


if __name__ == '__main__':
    sys.exit(main())
