"""Player of an excitation, which returns one command for each measured state."""

from __future__ import annotations

from enum import Enum

import numpy as np

from aerarm_ros.excitation.feasibility import EffortModel, StopLimits
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import MotionSequence
from aerarm_ros.motion.path_stop import PathTime, stop_along
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointCommand, JointReference


class FeedForwardLaw:
    """Control law that commands position, velocity and feed-forward torque, thesis (4.4).

    Parameters
    ----------
    effort_model : prior inverse dynamics.
    """

    def __init__(self, effort_model: EffortModel) -> None:
        self._effort_model = effort_model

    def command(self, reference: JointReference, position: Array) -> JointCommand:
        """Return the reference with feed-forward torque; the boards close the position loop."""
        effort = self._effort_model.effort(*(np.atleast_2d(part) for part in reference))[0]
        return JointCommand(reference.q, reference.dq, effort)


class VelocityLaw:
    """Kinematic control: dq_cmd = dq_d + K (q_d - q), thesis section 2.5.2 in joint space.

    The boards integrate the velocity reference, so the positions drift only slowly. A small K
    removes this drift without stiffening the control loop.

    Parameters
    ----------
    gain : gain K [1/s], 0 for the thesis's pure velocity commands.
    limit : (n,) largest commanded speed [rad/s]. The limit is needed because the correction K
        (q_d - q) cannot be checked before the motion.
    """

    def __init__(self, gain: float, limit: Array | float = np.inf) -> None:
        self._gain = gain
        self._limit: Array = np.asarray(limit, dtype=float)

    def command(self, reference: JointReference, position: Array) -> JointCommand:
        """Return the velocity command at the measured `position` (n,) [rad]."""
        correction = self._gain * (reference.q - position)
        # Not np.clip, which would dominate the time of this 1 kHz call.
        velocity = np.minimum(reference.dq + correction, self._limit)
        return JointCommand(dq=np.maximum(velocity, -self._limit))


CommandLaw = FeedForwardLaw | VelocityLaw
"""Control law that maps a reference and the measured position to a command."""


class PlayState(Enum):
    """State of an excitation player: waiting, playing, stopping, finished or aborted."""

    RUNNING = 'running'
    STOPPING = 'stopping'
    FINISHED = 'finished'
    STOPPED = 'stopped'


class ExcitationPlayer:
    """Player that returns one command per measured state until the motion ends.

    The time of the motion is taken from the stamps of the states, so a lost message causes a gap
    in the commands but does not delay the motion.

    Parameters
    ----------
    motion : motion to play, starting at rest in the posture of the first state.
    law : control law of the command.
    stops : limits of a stop, which brakes along the motion's path as hard as they allow.
    tracking_limit : largest |q_d - q| of a joint before the motion is stopped [rad].
    largest_gap : largest time between two states [s].

    Raises
    ------
    ExcitationError
        If a limit or time is not positive.
    """

    START_TOLERANCE = 0.05
    """Largest accepted joint motion between planning and start [rad]."""

    def __init__(
        self,
        motion: MotionSequence,
        law: CommandLaw,
        stops: StopLimits,
        tracking_limit: float = 0.3,
        largest_gap: float = 0.1,
    ) -> None:
        if min(tracking_limit, largest_gap) <= 0.0:
            raise ExcitationError(
                'tracking limit and largest gap between joint states must be positive'
            )
        self.motion = motion
        self._law = law
        self._stops = stops
        self._joint_names = stops.limits.joint_names
        self._tracking_limit = tracking_limit
        self._largest_gap_ns = round(largest_gap * 1e9)
        # path time as a function of time, after a stop has begun
        self._stop: PolynomialPath | None = None
        self._stop_at = 0.0
        self._start_ns: int | None = None
        self._last_ns = 0
        self.state = PlayState.RUNNING
        self.fault: str | None = None
        """Reason why the motion was aborted, None if it was not."""
        self.path_time = 0.0
        """Time in the motion at the last measured state [s]."""
        self.largest_error = np.zeros(len(self._joint_names))
        """Largest tracking error |q_d - q| so far (n,) [rad]."""

    @property
    def done(self) -> bool:
        """Whether the motion has ended and no further command is needed."""
        return self.state in (PlayState.FINISHED, PlayState.STOPPED)

    @property
    def progress(self) -> float:
        """Fraction of the motion already played, 0 to 1."""
        return min(self.path_time / self.motion.duration, 1.0)

    @property
    def stage(self) -> str:
        """Name of the stage of the motion that is being played."""
        return self.motion.stage_at(self.path_time).name

    def stop(self) -> None:
        """Request a stop along the path of the motion; the stop begins at the next state."""
        if self.state is PlayState.RUNNING:
            self.state = PlayState.STOPPING

    def hold(self, position: Array) -> JointCommand:
        """Return the command that holds the arm at the start of the motion, before it begins.

        Parameters
        ----------
        position : measured posture (n,) [rad].

        Raises
        ------
        ExcitationError
            If the posture is not finite, or differs from the start of the motion.
        """
        self._require_start(position)
        start = self.motion.evaluate(0.0)
        self._check_tracking(start.q - position)
        return self._law.command(start, position)

    def update(self, stamp_ns: int, position: Array) -> JointCommand:
        """Return the command for one measured state.

        Parameters
        ----------
        stamp_ns : stamp of the state [ns].
        position : measured posture (n,) [rad].

        Raises
        ------
        ExcitationError
            If the stamp jumps or the posture is not finite, because the arm's state is then
            unknown. Also if the first posture differs from the start of the motion.
        """
        if self._start_ns is None:
            self._require_start(position)
        now = self._elapsed(stamp_ns)
        if self.state is PlayState.STOPPING and self._stop is None:
            self._stop = stop_along(self.motion.evaluate, now, self._stops.rows).clock()
            self._stop_at = now
        path = self._path_time(now)
        self.path_time = path.value
        reference = self._reference(path)
        self._check_tracking(reference.q - position)
        if self._stop is not None and now >= self._stop_at + self._stop.duration:
            self.state = PlayState.STOPPED
        elif self.path_time >= self.motion.duration:
            self.state = PlayState.FINISHED
        command = self._law.command(reference, position)
        return self._with_braking(command, path) if command.tau is None else command

    def ahead(self, times: Array) -> JointReference | None:
        """Return references (M, n) at times (M,) [s] after the last state; None before a state."""
        if self._start_ns is None:
            return None
        now = (self._last_ns - self._start_ns) * 1e-9
        rows = [self._reference(self._path_time(now + time)) for time in times.tolist()]
        return JointReference(*map(np.array, zip(*rows, strict=True)))

    def _require_start(self, position: Array) -> None:
        moved = np.abs(self.motion.evaluate(0.0).q - position)
        worst = int(moved.argmax())
        if moved[worst] > self.START_TOLERANCE:
            raise ExcitationError(
                f'{self._joint_names[worst]} moved by {moved[worst]:.3f} rad after the motion '
                'was planned: check that the arm is held and that no person or node moves it, '
                'then try again'
            )

    def _elapsed(self, stamp_ns: int) -> float:
        if self._start_ns is None:
            self._start_ns = self._last_ns = stamp_ns
        gap = stamp_ns - self._last_ns
        if not 0 <= gap <= self._largest_gap_ns:
            raise ExcitationError(
                f'joint state stamps jump by {gap * 1e-9:.3f} s: check that exactly one bridge '
                'publishes joint_states without pauses and that no program sets its clock'
            )
        self._last_ns = stamp_ns
        return (stamp_ns - self._start_ns) * 1e-9

    def _reference(self, path: PathTime) -> JointReference:
        along = self.motion.evaluate(path.value)
        return along if self._stop is None else along.paced(path.rate, path.rate_change)

    def _path_time(self, now: float) -> PathTime:
        if self._stop is None:
            return PathTime(now, 1.0, 0.0)
        return PathTime(*(float(part[0]) for part in self._stop.evaluate(now - self._stop_at)))

    def _with_braking(self, command: JointCommand, path: PathTime) -> JointCommand:
        """Add the braking torque of a stop, because a velocity loop alone reacts with a delay.

        The torque is zero at the beginning and the end of a stop.
        """
        if self._stop is None:
            return command
        q, dq, _ = self.motion.evaluate(path.value)
        return command._replace(tau=self._stops.inertial_torque(q, path.rate_change * dq))

    def _check_tracking(self, error: Array) -> None:
        distance = np.abs(error)
        # the first joint with NaN; otherwise the joint farthest away
        worst = int(distance.argmax())
        if np.isnan(distance[worst]):
            raise ExcitationError('a joint state contains NaN: check the encoders and the bridge')
        np.maximum(self.largest_error, distance, out=self.largest_error)
        if distance[worst] > self._tracking_limit and self.fault is None:
            self.fault = (
                f'{self._joint_names[worst]} is {distance[worst]:.3f} rad off its reference in '
                f'the {self.stage} (limit {self._tracking_limit:g} rad): check for contact, '
                'saturated motors and the tracking_limit parameter'
            )
            self.stop()
