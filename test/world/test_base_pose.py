"""The base's pose with late, noisy, silent, frozen, repeated or jumping odometry."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.flight.flight_state import OdometrySample
from aerarm_ros.world.base_pose import BasePoseEstimator, OdometryFrames

Array = npt.NDArray[np.float64]

SWING, SPEED = 0.1, 3.0  # [m], [rad/s]
LEVER = np.array([0.03, 0.0, 0.02])
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
CYCLE = 4e-3
FRAMES = OdometryFrames(np.array([0.0, 0.0, -0.08]), np.diag([1.0, -1.0, -1.0]), LEVER, np.eye(3))


def place(time: float) -> Array:
    return np.array([SWING * np.sin(SPEED * time), 0.0, 1.0])


def odometry(time: float) -> OdometrySample:
    velocity = np.array([SWING * SPEED * np.cos(SPEED * time), 0.0, 0.0])
    return OdometrySample(time, place(time), LEVEL, velocity, np.zeros(3))


def imu(time: float, clock: float = 0.0, rate: Array | float = 0.0) -> ImuSample:
    force = np.array([-SWING * SPEED**2 * np.sin(SPEED * time), 0.0, 9.81])
    return ImuSample(time + clock, None, np.zeros(3) + rate, force)


Change = Callable[[OdometrySample], list[OdometrySample]]


class Feed:
    """Feed of an estimator: IMU at 250 Hz, odometry at a rate, delayed."""

    def __init__(self, rate: float = 100.0, late: float = 0.012, has_imu: bool = True) -> None:
        self.estimator = BasePoseEstimator(FRAMES)
        self.now = 0.0
        self._interval, self._late, self._has_imu = 1.0 / rate, late, has_imu
        self.due = 0.0
        self.change: Change = lambda sample: [sample]
        self.reasons: list[str] = []
        self.clock = 0.0
        self.rate_bias: Array | float = 0.0  # of the gyroscope [rad/s]

    def run(self, seconds: float) -> Iterator[float]:
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            if self._has_imu:
                self.estimator.offer_imu(imu(self.now, self.clock, self.rate_bias), self.now)
            if self.now >= self.due + self._late:
                for sample in self.change(odometry(self.due)):
                    try:
                        self.estimator.offer_odometry(sample, self.now)
                    except RejectedInputError as error:
                        self.reasons.append(str(error))
                self.due += self._interval
            yield self.now

    def errors(self, seconds: float) -> Array:
        """Return the error of the position (M,) [m] while the pose is usable."""
        rows = []
        for now in self.run(seconds):
            if not self.estimator.problem(now):
                pose = self.estimator.pose(now)
                rows.append(pose.position - (place(now) + FRAMES.base_position))
        return np.linalg.norm(np.array(rows), axis=1)

    def settle(self, seconds: float = 1.0, change: Change | None = None) -> None:
        self.change = change or self.change
        for _ in self.run(seconds):
            pass

    @property
    def problem(self) -> str:
        return self.estimator.problem(self.now)


def shifted(shift: Array | float) -> Change:
    return lambda sample: [replace(sample, position=sample.position + shift)]


def stamped(clock: float) -> Change:
    return lambda sample: [replace(sample, stamp=sample.stamp + clock)]


def unchanged(sample: OdometrySample) -> list[OdometrySample]:
    return [sample]


@pytest.mark.parametrize(
    ('feed', 'largest'),
    [(Feed(rate=30.0, late=0.03), 1e-3), (Feed(has_imu=False), 2e-3)],
    ids=['late odometry bridged by the IMU', 'no IMU, bridged by the velocity'],
)
def test_late_or_missing_inputs_are_bridged(feed: Feed, largest: float) -> None:
    feed.settle()
    errors = feed.errors(3.0)
    assert len(errors) == 750
    assert errors.max() < largest
    assert feed.estimator.age == pytest.approx(feed._late, abs=0.005)


def test_noise_is_measured_and_left_out() -> None:
    feed, random = Feed(), np.random.default_rng(0)
    feed.settle(1.0, lambda sample: shifted(5e-3 * random.standard_normal(3))(sample))
    errors = feed.errors(5.0)
    assert feed.estimator.noise[0] == pytest.approx(5e-3, rel=0.3)
    assert np.sqrt((errors**2).mean()) < 0.5 * 5e-3 * np.sqrt(3.0)


def test_the_bias_of_the_gyroscope_causes_no_lasting_error_and_a_large_one_is_named() -> None:
    feed = Feed()
    feed.rate_bias = np.array([0.01, -0.02, 0.01])
    feed.settle(8.0)
    pose = feed.estimator.pose(feed.now)
    # Without an estimate of the bias, the attitude would be off by 0.5 s times the bias.
    assert np.abs(pose.rotation - FRAMES.base_rotation).max() < 5e-4
    assert np.abs(pose.rate).max() < 1e-3
    assert feed.estimator.warning() == ''
    feed.rate_bias = np.array([0.0, 0.0, 0.2])
    feed.settle(8.0)
    assert 'bias of the gyroscope' in feed.estimator.warning()
    late = Feed(late=0.15)
    late.settle()
    assert 'old on average' in late.estimator.warning()


@pytest.mark.parametrize(
    ('change', 'said', 'is_named'),
    [
        (stamped(-5.0), 'synchronise the clocks', False),
        (lambda sample: [replace(odometry(1.0), stamp=sample.stamp)], 'frozen', False),
        (shifted(3.0), 'jumped by', True),
    ],
    ids=['clock', 'frozen', 'jump'],
)
def test_a_lasting_fault_is_named_until_it_ends_or_somebody_gives_a_target(
    change: Change, said: str, is_named: bool
) -> None:
    feed = Feed()
    feed.settle()
    feed.settle(8.0 if is_named else 1.0, change)
    assert said in feed.problem
    if is_named:
        feed.estimator.accept_next()
    feed.settle(1.0, change if is_named else unchanged)
    assert feed.problem == ''


@pytest.mark.parametrize(
    ('change', 'seconds', 'largest', 'last'),
    [
        (lambda sample: [sample, sample], 2.0, 1e-3, 1e-3),
        (shifted(0.3), CYCLE * 3, 2e-3, 2e-3),
        (lambda s: [replace(s, velocity=s.velocity + 3.0)], CYCLE * 3, 0.02, 2e-3),
    ],
    ids=['twice', 'wrong position', 'wrong velocity'],
)
def test_single_wrong_samples_leave_the_pose_usable_and_near(
    change: Change, seconds: float, largest: float, last: float
) -> None:
    feed = Feed()
    feed.settle()
    feed.settle(seconds, change)
    feed.change = unchanged
    errors = feed.errors(2.0)
    assert len(errors) == round(2.0 / CYCLE)
    assert errors.max() < largest
    assert errors[-1] < last
    assert feed.estimator.jumps == 0
    if seconds == 2.0:
        assert feed.estimator.rejections > 100
        assert not feed.reasons, 'a repeated sample is no fault'


def test_a_small_jump_is_accepted_once_it_stays() -> None:
    feed = Feed()
    feed.settle()
    shift = np.array([0.0, 0.3, 0.0])
    feed.settle(0.08, shifted(shift))
    assert feed.estimator.jumps == 0
    feed.settle()
    assert feed.estimator.jumps == 1
    pose = feed.estimator.pose(feed.now)
    assert pose.position == pytest.approx(place(feed.now) + FRAMES.base_position + shift, abs=2e-3)


def test_the_pose_is_found_again_after_the_arms_clock_was_set_back() -> None:
    feed = Feed()
    feed.clock = 100.0
    feed.settle(1.0, stamped(100.0))
    now = feed.now
    feed.now -= 2.0
    feed.clock += 2.0
    feed.due -= 2.0
    feed.change = lambda sample: stamped(100.0)(odometry(sample.stamp + 2.0))
    reached = [now for now in feed.run(1.0) if not feed.estimator.problem(now)]
    assert reached and feed.now < now
    assert np.abs(feed.estimator.pose(feed.now).rotation - FRAMES.base_rotation).max() < 1e-3


def test_a_step_of_the_attitude_is_no_bias_of_the_gyroscope() -> None:
    feed, half = Feed(), 0.07
    feed.settle()
    step = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
    feed.change = lambda sample: [replace(sample, attitude=step)]
    rates = [abs(feed.estimator.pose(now).rate[2]) for now in feed.run(4.0)]
    assert max(rates) < 0.03


@pytest.mark.parametrize('turn', [0.0, 0.14])
def test_a_jump_too_small_to_be_detected_moves_the_tool_slowly(turn: float) -> None:
    feed = Feed(rate=30.0, late=0.03)
    feed.estimator = BasePoseEstimator(FRAMES, recovery_speed=0.05)
    feed.settle()
    shift = np.array([0.0, 0.0 if turn else 0.025, 0.0])
    turned = np.array([0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)])
    ahead = np.array([np.cos(turn), -np.sin(turn), 0.0])  # the velocity stays along x of the world

    def changed(sample: OdometrySample) -> list[OdometrySample]:
        (moved,) = shifted(shift)(sample)
        return [replace(moved, attitude=turned, velocity=moved.velocity[0] * ahead)]

    feed.change = changed
    tool = FRAMES.base_rotation.T @ np.array([0.4, 0.0, -0.2])
    still = FRAMES.base_position + FRAMES.base_rotation @ tool
    poses = [(now, feed.estimator.pose(now)) for now in feed.run(3.0)]
    off = np.array([pose.to_world(tool) - place(now) - still for now, pose in poses])
    speed = np.linalg.norm(off[15:] - off[:-15], axis=1) / (15 * CYCLE)
    assert feed.estimator.jumps == 0
    assert speed.max() < 0.06
    assert np.linalg.norm(off[-1]) > 0.02


@pytest.mark.parametrize('clock', [-0.1, 0.1, 1000.0])
def test_a_clock_of_its_own_is_compared_by_the_imu_and_named(clock: float) -> None:
    feed = Feed()
    feed.clock = clock
    feed.settle(1.0, stamped(clock))
    assert feed.errors(2.0).max() < 2e-3
    assert 'synchronise' in feed.estimator.warning()
    if clock == 1000.0:
        return
    feed.clock = 0.0
    feed.settle(6.0, unchanged)
    assert feed.estimator.warning() == ''
    assert feed.errors(2.0).max() < 2e-3


def test_a_slow_imu_that_loses_samples_does_no_harm() -> None:
    random = np.random.default_rng(0)
    for _ in range(100):
        estimator = BasePoseEstimator(FRAMES)
        events = [(0.04 * k, 0.024, True) for k in range(40) if random.random() > 0.2]
        events += [(0.02 * k, 0.077, False) for k in range(80) if random.random() > 0.2]
        for stamp, late, is_imu in sorted(events, key=lambda event: event[0] + event[1]):
            now = stamp + late + 0.005 * random.random()
            if is_imu:
                estimator.offer_imu(imu(stamp), now)
            else:
                with suppress(RejectedInputError):
                    estimator.offer_odometry(odometry(stamp), now)
        assert np.isfinite(estimator.pose(now).position).all()
