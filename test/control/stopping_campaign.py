"""Stops and random preemptions of a trajectory follower: distances, and the limits kept.

    python test/control/stopping_campaign.py [--preemptions 10000] [--seed 1]

prints the tables of docs/benchmarks_safety.md, section Stopping. Only the preemptions are random,
and their seed is printed. All times are inputs; no clock is read.
"""

import argparse
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.player import ExcitationPlayer, VelocityLaw
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.excitation.trajectory import MotionSequence, Stage
from aerarm_ros.motion.polynomial_path import smooth_step
from aerarm_ros.motion.signals import JointReference

Array = npt.NDArray[np.float64]

CYCLE = 1e-3
SHARES = (0.3, 0.6, 0.95)  # fractions of a joint's velocity limit at which stops are measured
PLAYED = 0.5  # longest time between two preemptions [s]


def make_follower(limits: JointLimits, q: Array) -> TrajectoryFollower:
    """Return a follower that holds at `q` and does not limit the arm's tracking error."""
    tolerances = FollowerTolerances.uniform(limits.n, start=0.1, path=10.0)
    follower = TrajectoryFollower(limits, tolerances)
    follower.take_over(q)
    return follower


# Distances.


def cruise(limits: JointLimits, joint: int, speed: float) -> JointTrajectory:
    """Return a trajectory that passes the middle of a joint's range at `speed` [rad/s].

    The trajectory begins at that speed, for a follower that starts in its middle.
    """
    middle = 0.5 * (limits.position_min + limits.position_max)
    ramp = 2.5 * speed / limits.acceleration_max[joint]
    room = 0.48 * (limits.position_max[joint] - limits.position_min[joint]) - 0.5 * ramp * speed
    even = min(0.3, room / speed)
    times = np.array([0.0, ramp, ramp + 2.0 * even, 2.0 * (ramp + even)])
    travel = np.array([0.0, 0.5 * ramp, 0.5 * ramp + 2.0 * even, ramp + 2.0 * even]) * speed
    q, dq, ddq = np.tile(middle, (4, 1)), np.zeros((4, limits.n)), np.zeros((4, limits.n))
    q[:, joint] += travel - travel.mean()
    dq[1:3, joint] = speed
    rows = [row.tolist() for row in (q, dq, ddq)]
    return JointTrajectory(limits, limits.names, times.tolist(), *rows)


def settle(follower: TrajectoryFollower, now: float) -> Array:
    """Return the posture at which the reference comes to rest."""
    for cycle in range(1, 4000):
        follower.update(follower.reference.q, now + cycle * CYCLE, CYCLE)
        if not (follower.reference.dq.any() or follower.reference.ddq.any()):
            break
    return follower.reference.q


def canceled_travel(limits: JointLimits, joint: int, speed: float) -> float:
    """Return a joint's travel [rad] after a trajectory is canceled at `speed` [rad/s]."""
    trajectory = cruise(limits, joint, speed)
    follower = make_follower(limits, trajectory.q[0])
    follower.follow(trajectory, 0.0)
    now = float(trajectory.times[1:3].mean())
    before = follower.update(follower.reference.q, now, CYCLE)
    assert abs(before.dq[joint] - speed) < 1e-6 * speed
    follower.stop(now, 'canceled')
    return abs(float(settle(follower, now)[joint] - before.q[joint]))


def silent_travel(limits: JointLimits, joint: int, speed: float) -> float:
    """Return a joint's travel [rad] after a stream has timed out at `speed` [rad/s]."""
    start = 0.5 * (limits.position_min + limits.position_max)
    start[joint] = limits.position_min[joint] + 0.1
    follower = make_follower(limits, start)
    acceleration = 0.5 * limits.acceleration_max[joint]
    length = speed / acceleration
    now = 0.0
    while now < length + 0.15:
        at = min(now, length)
        q, dq, ddq = start.copy(), np.zeros(limits.n), np.zeros(limits.n)
        q[joint] += 0.5 * acceleration * at**2 + speed * (now - at)
        dq[joint] = acceleration * at
        ddq[joint] = acceleration * (now < length)
        rows = [[row.tolist()] for row in (q, dq, ddq)]
        follower.follow(JointTrajectory(limits, limits.names, [0.0], *rows), now)
        follower.update(follower.reference.q, now, CYCLE)
        now += 0.01
    timeout = follower.tolerances.stream_timeout
    last = follower.ahead(np.array([now - 0.01 + timeout]))
    assert abs(last.dq[0, joint] - speed) < 0.01 * speed, last
    return abs(float(settle(follower, now)[joint] - last.q[0, joint]))


def played_travel(limits: JointLimits, joint: int, speed: float) -> float:
    """Return a joint's travel [rad] after a player is stopped at `speed` [rad/s]."""
    trajectory = cruise(limits, joint, speed)
    motion = trajectory.path(trajectory.q[0])
    player = ExcitationPlayer(
        MotionSequence([Stage('cruise', motion)]),
        VelocityLaw(0.0),
        StopLimits(MotionLimits.of_arm(load_arm_config()), None),
        tracking_limit=10.0,
        largest_gap=10.0,
    )
    before = motion.evaluate(float(trajectory.times[1:3].mean()))
    player.update(0, trajectory.q[0])
    stamp_ns = round(1e9 * trajectory.times[1:3].mean())
    player.stop()
    while not player.done:
        player.update(stamp_ns, before.q)
        stamp_ns += round(1e9 * CYCLE)
    return abs(float(motion.evaluate(player.path_time).q[joint] - before.q[joint]))


TRAVELS = (canceled_travel, silent_travel, played_travel)


def print_distances(limits: JointLimits) -> None:
    """Print the travel of stops, the least possible travel, and the travel of the former method."""
    print(
        'joint  speed [rad/s]  least [rad]  before [rad]  cancel [rad]  stream [rad]  '
        'player before [rad]  player [rad]  worst/least'
    )
    for joint in range(limits.n):
        for share in SHARES:
            speed = share * limits.velocity_max[joint]
            least = speed**2 / (2.0 * limits.acceleration_max[joint])
            cancel, silent, played = (travel(limits, joint, speed) for travel in TRAVELS)
            # In the former method each joint stopped with a quarter of its acceleration on
            # average, and a player stopped within 0.5 s.
            print(
                f'{joint + 1:5d}  {speed:13.2f}  {least:11.3f}  {4.0 * least:12.3f}  '
                f'{cancel:12.3f}  {silent:12.3f}  {0.25 * speed:19.3f}  {played:12.3f}  '
                f'{max(cancel, silent, played) / least:11.2f}'
            )


# Preemptions.


@dataclass
class Tally:
    """Extremes of a run of preemptions."""

    tried: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    beyond: float = -np.inf  # largest distance beyond a position limit [rad]
    velocity: float = 0.0  # largest fraction of a velocity limit
    acceleration: float = 0.0

    def take(self, rows: JointReference, limits: JointLimits) -> None:
        """Update the extremes by references (M, n)."""
        beyond = np.maximum(limits.position_min - rows.q, rows.q - limits.position_max)
        self.beyond = max(self.beyond, float(beyond.max()))
        self.velocity = max(self.velocity, float((np.abs(rows.dq) / limits.velocity_max).max()))
        share = np.abs(rows.ddq) / limits.acceleration_max
        self.acceleration = max(self.acceleration, float(share.max()))


class Preemptions:
    """A follower that receives new motions at random times."""

    def __init__(self, limits: JointLimits, seed: int) -> None:
        self._limits = limits
        self._random = np.random.default_rng(seed)
        self.follower = make_follower(limits, self._posture())
        self.now = 0.0
        self.tally = Tally()

    def run(self, preemptions: int) -> Tally:
        """Preempt so many times; return the extremes."""
        events = (self._trajectory, self._replanned, self._fourier, self._point, self._set_point)
        events += (self._stream, self._stop, self._blocked)
        for _ in range(preemptions):
            event = events[self._random.integers(len(events))]
            name = event.__name__.strip('_')
            self.tally.tried += 1
            try:
                event()
            except RejectedInputError:
                self.tally.rejected[name] = self.tally.rejected.get(name, 0) + 1
            self._play(self._random.uniform(0.02, PLAYED))
        return self.tally

    def _play(self, seconds: float) -> None:
        times = self.now + np.arange(0.0, seconds, 2.0 * CYCLE)
        self.tally.take(self.follower.ahead(times), self._limits)
        self.now += seconds
        self.follower.update(self.follower.reference.q, self.now, CYCLE)

    def _posture(self) -> Array:
        """Return a posture, near a limit in half of the cases."""
        low, high = self._limits.position_min, self._limits.position_max
        return low + self._random.beta(0.4, 0.4, self._limits.n) * (high - low)

    def _follow(self, times: Array, *rows: Array) -> None:
        limits = self._limits
        lists = [row.tolist() for row in rows]
        trajectory = JointTrajectory(limits, limits.names, times.tolist(), *lists)
        self.follower.follow(trajectory, self.now, is_goal=True)

    def _follow_way(self, times: Array, q: Array) -> None:
        if self._random.random() < 0.5:
            self._follow(times, q, np.zeros_like(q))  # with rests, so that no joint overshoots
        else:
            self._follow(times, q)

    def _way(self, start: Array, points: int) -> tuple[Array, Array]:
        """Return times and points of a path at a random pace within the limits."""
        q = np.array([start] + [self._posture() for _ in range(points)])
        limits = self._limits
        steps = np.abs(np.diff(q, axis=0))
        needed = np.maximum(
            1.9 * steps / limits.velocity_max, np.sqrt(5.8 * steps / limits.acceleration_max)
        )
        pace = self._random.uniform(1.0, 2.5 if points == 1 else 4.0)
        return np.cumsum(pace * np.maximum(needed.max(axis=1), 0.05)), q

    def _trajectory(self) -> None:
        times, q = self._way(self.follower.reference.q, self._random.integers(1, 4))
        self._follow_way(times, q[1:])

    def _replanned(self) -> None:
        """Send a trajectory from the present or a recent posture at rest, as a planner does."""
        start = self.follower.reference.q + self._random.uniform(-0.05, 0.05, self._limits.n)
        start = np.clip(start, self._limits.position_min, self._limits.position_max)
        times, q = self._way(start, self._random.integers(1, 4))
        self._follow_way(np.append(0.0, times), q)

    def _fourier(self) -> None:
        """Send a sampled excitation that begins at its own speed, possibly in its middle."""
        limits, random = self._limits, self._random
        w = 2.0 * np.pi * random.uniform(0.2, 0.5)
        room = 0.5 * (limits.position_max - limits.position_min)
        size = random.uniform(0.1, 0.9, limits.n) * np.minimum(room, limits.velocity_max / w)
        size = np.minimum(size, 0.9 * limits.acceleration_max / w**2)
        middle = np.clip(
            self.follower.reference.q, limits.position_min + size, limits.position_max - size
        )
        length = 2.0 * np.pi / w
        times = np.linspace(0.0, length, 30)[:, np.newaxis]
        fade = smooth_step(2.0 * times / length - 1.0)
        share, falling = 1.0 - fade.value, -2.0 * fade.slope / length
        wave, slope = size * np.sin(w * times), w * size * np.cos(w * times)
        self._follow(times[:, 0], middle + share * wave, share * slope + falling * wave)

    def _point(self) -> None:
        """Send a goal of one point without a time, at which the arm stays."""
        near = self.follower.reference.q + self._random.uniform(-0.09, 0.09, self._limits.n)
        near = np.clip(near, self._limits.position_min, self._limits.position_max)
        self._follow(np.zeros(1), near[np.newaxis])

    def _set_point(self) -> None:
        self.follower.go_to(self._posture(), self.now)

    def _stream(self) -> None:
        """Send some points that continue the present motion, then none."""
        limits, random = self._limits, self._random
        q, dq, _ = self.follower.reference
        with_acceleration = random.random() < 0.5
        a = limits.acceleration_max
        pull = random.uniform(-0.7, 0.7, limits.n) * a
        period = random.uniform(0.002, 0.05)
        for _ in range(random.integers(1, 20)):
            # The stream reverses at its turning points, sometimes too late.
            ends = q + dq * np.abs(dq) / (random.uniform(0.4, 1.2) * a) + 0.2 * dq
            outside = (ends > limits.position_max) | (ends < limits.position_min)
            turns = outside | (np.abs(dq + 0.1 * pull) > limits.velocity_max)
            pull = np.where(turns, -0.7 * np.sign(dq) * a, pull)
            q, dq = q + period * (dq + 0.5 * period * pull), dq + period * pull
            q = np.clip(q, limits.position_min, limits.position_max)
            dq = np.clip(dq, -limits.velocity_max, limits.velocity_max)
            rows = [[row.tolist()] for row in (q, dq, *([pull] if with_acceleration else []))]
            try:
                point = JointTrajectory(limits, limits.names, [0.0], *rows)
                self.follower.follow(point, self.now)
            except RejectedInputError:
                self.tally.rejected['point'] = self.tally.rejected.get('point', 0) + 1
            self._play(period)

    def _stop(self) -> None:
        self.follower.stop(self.now, 'canceled')

    def _blocked(self) -> None:
        """Hold an arm that has left its path."""
        q = self.follower.reference.q + self._random.uniform(-0.3, 0.3, self._limits.n)
        self.follower.stop(self.now, 'off path', q)


def run_preemptions(limits: JointLimits, preemptions: int, seed: int, each: int = 50) -> Tally:
    """Preempt many followers, `each` times per follower; return the extremes of all."""
    total = Tally()
    for run in range(-(-preemptions // each)):
        tally = Preemptions(limits, seed + run).run(min(each, preemptions - total.tried))
        total.tried += tally.tried
        for name, number in tally.rejected.items():
            total.rejected[name] = total.rejected.get(name, 0) + number
        total.beyond = max(total.beyond, tally.beyond)
        total.velocity = max(total.velocity, tally.velocity)
        total.acceleration = max(total.acceleration, tally.acceleration)
    return total


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--preemptions', type=int, default=10_000)
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    limits = JointLimits.from_config(load_arm_config())
    print_distances(limits)
    tally = run_preemptions(limits, options.preemptions, options.seed)
    print(f'\n{tally.tried} preemptions, seed {options.seed}: rejected {tally.rejected}')
    print(f'largest distance beyond a position limit: {tally.beyond:.2g} rad')
    print(f'of the velocity limit: {tally.velocity:.4f}, acceleration: {tally.acceleration:.4f}')


if __name__ == '__main__':
    main()
