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


def odometry(time: float, shift: Array | float = 0.0, noise: Array | float = 0.0) -> OdometrySample:
    velocity = np.array([SWING * SPEED * np.cos(SPEED * time), 0.0, 0.0])
    return OdometrySample(time, place(time) + shift + noise, LEVEL, velocity, np.zeros(3))


def imu(time: float, clock: float = 0.0, rate: Array | float = 0.0) -> ImuSample:
    force = np.array([-SWING * SPEED**2 * np.sin(SPEED * time), 0.0, 9.81])
    return ImuSample(time + clock, None, np.zeros(3) + rate, force)


class Feed:
    """Feed of an estimator: IMU at 250 Hz, odometry at a rate, delayed."""

    def __init__(self, rate: float = 100.0, late: float = 0.012, has_imu: bool = True) -> None:
        self.estimator = BasePoseEstimator(FRAMES)
        self.now = 0.0
        self._interval, self._late, self._has_imu = 1.0 / rate, late, has_imu
        self._due = 0.0
        self.change: Callable[[OdometrySample], list[OdometrySample]] = lambda sample: [sample]
        self.reasons: list[str] = []
        self.clock = 0.0
        self.rate_bias: Array | float = 0.0  # of the gyroscope [rad/s]

    def run(self, seconds: float) -> Iterator[float]:
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            if self._has_imu:
                self.estimator.offer_imu(imu(self.now, self.clock, self.rate_bias), self.now)
            if self.now >= self._due + self._late:
                for sample in self.change(odometry(self._due)):
                    try:
                        self.estimator.offer_odometry(sample, self.now)
                    except RejectedInputError as error:
                        self.reasons.append(str(error))
                self._due += self._interval
            yield self.now

    def errors(self, seconds: float) -> Array:
        rows = []
        for now in self.run(seconds):
            if not self.estimator.problem(now):
                pose = self.estimator.pose(now)
                rows.append(pose.position - (place(now) + FRAMES.base_position))
        return np.linalg.norm(np.array(rows), axis=1)

    def settle(self) -> None:
        for _ in self.run(1.0):
            pass


def test_a_late_odometry_is_bridged_by_the_imu() -> None:
    feed = Feed(rate=30.0, late=0.03)
    feed.settle()
    assert feed.errors(3.0).max() < 1e-3
    assert feed.estimator.age == pytest.approx(0.03, abs=0.005)


def test_without_imu_the_velocity_bridges() -> None:
    feed = Feed(has_imu=False)
    feed.settle()
    errors = feed.errors(3.0)
    assert len(errors) == 750
    assert errors.max() < 2e-3


def test_noise_is_measured_and_left_out() -> None:
    feed, random = Feed(), np.random.default_rng(0)
    feed.change = lambda sample: [odometry(sample.stamp, noise=5e-3 * random.standard_normal(3))]
    feed.settle()
    errors = feed.errors(5.0)
    assert feed.estimator.noise[0] == pytest.approx(5e-3, rel=0.3)
    assert np.sqrt((errors**2).mean()) < 0.5 * 5e-3 * np.sqrt(3.0)


def test_the_bias_of_the_gyroscope_causes_no_lasting_error() -> None:
    feed = Feed()
    feed.rate_bias = np.array([0.01, -0.02, 0.01])
    for _ in feed.run(8.0):
        pass
    pose = feed.estimator.pose(feed.now)
    # Without an estimate of the bias, the attitude would be off by 0.5 s times the bias.
    assert np.abs(pose.rotation - FRAMES.base_rotation).max() < 5e-4
    assert np.abs(pose.rate).max() < 1e-3


def test_clocks_that_differ_are_named() -> None:
    feed = Feed()
    feed.settle()
    feed.change = lambda sample: [
        OdometrySample(sample.stamp - 5.0, *list(vars(sample).values())[1:])
    ]
    feed.settle()
    assert 'synchronise the clocks' in feed.estimator.problem(feed.now)
    feed.change = lambda sample: [sample]
    feed.settle()
    assert feed.estimator.problem(feed.now) == ''


def test_a_frozen_odometry_is_named() -> None:
    feed = Feed()
    feed.settle()
    held = odometry(feed.now)
    feed.change = lambda sample: [OdometrySample(sample.stamp, *list(vars(held).values())[1:])]
    feed.settle()
    assert 'frozen' in feed.estimator.problem(feed.now)


def test_samples_that_come_twice_do_no_harm() -> None:
    feed = Feed()
    feed.settle()
    feed.change = lambda sample: [sample, sample]
    assert feed.errors(2.0).max() < 1e-3
    assert feed.estimator.rejections > 100
    assert not feed.reasons, 'a repeated sample is no fault'


def test_a_small_jump_is_accepted_once_it_stays() -> None:
    feed = Feed()
    feed.settle()
    shift = np.array([0.0, 0.3, 0.0])
    feed.change = lambda sample: [odometry(sample.stamp, shift)]
    for _ in feed.run(0.08):
        pass
    assert feed.estimator.jumps == 0
    feed.settle()
    assert feed.estimator.jumps == 1
    pose = feed.estimator.pose(feed.now)
    assert pose.position == pytest.approx(place(feed.now) + FRAMES.base_position + shift, abs=2e-3)


def test_one_wrong_sample_is_left_out() -> None:
    feed = Feed()
    feed.settle()
    feed.change = lambda sample: [odometry(sample.stamp, 0.3)]
    for _ in feed.run(CYCLE * 3):
        pass
    feed.change = lambda sample: [sample]
    errors = feed.errors(1.0)
    assert len(errors) == round(1.0 / CYCLE), 'the pose stays usable'
    assert errors.max() < 2e-3
    assert feed.estimator.jumps == 0


def test_one_wrong_velocity_does_not_move_the_pose_away() -> None:
    feed = Feed()
    feed.settle()
    feed.change = lambda sample: [replace(sample, velocity=sample.velocity + 3.0)]
    for _ in feed.run(CYCLE * 3):
        pass
    feed.change = lambda sample: [sample]
    errors = feed.errors(2.0)
    assert len(errors) == round(2.0 / CYCLE)
    assert errors.max() < 0.02
    assert errors[-1] < 2e-3


def test_the_pose_is_found_again_after_the_arms_clock_was_set_back() -> None:
    feed = Feed()
    feed.clock = 100.0
    late = feed._late
    feed.change = lambda sample: [replace(sample, stamp=sample.stamp + 100.0)]
    feed.settle()
    now = feed.now
    feed.now -= 2.0
    feed.clock += 2.0
    feed._due -= 2.0
    feed._late = late
    feed.change = lambda sample: [replace(odometry(sample.stamp + 2.0), stamp=sample.stamp + 102.0)]
    reached = [now for now in feed.run(1.0) if not feed.estimator.problem(now)]
    assert reached and feed.now < now
    assert np.abs(feed.estimator.pose(feed.now).rotation - FRAMES.base_rotation).max() < 1e-3


def test_a_large_jump_is_rejected_until_somebody_gives_a_target() -> None:
    feed = Feed()
    feed.settle()
    feed.change = lambda sample: [odometry(sample.stamp, 3.0)]
    for _ in feed.run(8.0):
        pass
    assert 'jumped by' in feed.estimator.problem(feed.now)
    feed.estimator.accept_next()
    feed.settle()
    assert feed.estimator.problem(feed.now) == ''


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
        moved = odometry(sample.stamp, shift)
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


@pytest.mark.parametrize('clock', [-0.1, 0.1])
def test_a_small_difference_of_the_clocks_is_corrected_and_named(clock: float) -> None:
    feed = Feed()
    feed.clock = clock
    feed.change = lambda sample: [replace(sample, stamp=sample.stamp + clock)]
    feed.settle()
    assert feed.errors(2.0).max() < 2e-3
    assert 'synchronise' in feed.estimator.warning()
    feed.clock = 0.0
    feed.change = lambda sample: [sample]
    for _ in feed.run(6.0):
        pass
    assert feed.estimator.warning() == ''
    assert feed.errors(2.0).max() < 2e-3


def test_sensors_that_hold_the_tool_poorly_are_named() -> None:
    feed = Feed(late=0.15)
    feed.settle()
    assert 'old on average' in feed.estimator.warning()
    feed = Feed()
    feed.rate_bias = np.array([0.0, 0.0, 0.2])
    for _ in feed.run(8.0):
        pass
    assert 'bias of the gyroscope' in feed.estimator.warning()


def test_a_clock_of_its_own_is_compared_by_the_imu() -> None:
    feed = Feed()
    feed.clock = 1000.0
    feed.change = lambda sample: [
        OdometrySample(sample.stamp + 1000.0, *list(vars(sample).values())[1:])
    ]
    feed.settle()
    assert feed.errors(1.0).max() < 2e-3


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
