"""Barrier of a joint: torque bounds that keep the joint within position and speed limits."""

from math import exp, nan, sqrt

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import JointConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.model.dynamics import Dynamics, largest_gravity_load
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.motion.signals import Array

_POSTURES = 500
# Fraction of the drive torque in excess of the largest load that is reserved for braking; the
# rest is a margin, because the real arm differs from its model and the motion of other joints
# adds load. For example, joint 1 at full speed loads joint 2 outward with 4 Nm if joint 2 is
# beyond 45 degrees.
_RELIABLE_SHARE = 0.5

# Largest speed of a falling damped arm relative to the velocity limits, and the time [s] to reach
# it, which is short compared to the fall from upright to a limit.
_FALLING_SHARE = 0.4
_DAMPING_TIME = 0.2


class JointLoads:
    """Load torques and inertias of n joints, computed with half the rated payload.

    Parameters
    ----------
    config
        Configuration with drives, limits and the rated payload.

    Attributes
    ----------
    load_max
        (n,) largest gravity torque with the rated payload over all base orientations [Nm].
    inertia_max
        (n,) largest inertia with the rated payload [kg m^2].
    deceleration
        (n,) deceleration that the drives provide with any payload up to the rated one [rad/s^2]:
        the configured acceleration limit, or less if the torque in excess of the load does not
        suffice.

    damping_min
        (n,) damping [Nms/rad] with which a released, stretched-out arm with the rated payload falls
        at 0.4 of the velocity limit at most and reaches that speed in 0.2 s.

    Raises
    ------
    ValueError
        If configuration and robot belong to different arms, or a drive cannot hold the arm.
    """

    def __init__(self, config: ArmConfig, robot: Robot) -> None:
        if config.joint_names != robot.joint_names:
            raise ValueError(
                f'the configuration has joints {config.joint_names}, but the URDF has '
                f'{robot.joint_names}: pass files of the same arm'
            )
        inertia = config.column('reflected_inertia')
        mass, *centre = config.rated_payload
        payload = point_mass(mass, centre)
        self._dynamics = Dynamics(robot, inertia)
        self._dynamics.carry(0.5 * payload)
        loaded = np.array(robot.inertial_parameters)
        loaded[-1] += payload
        whole = robot.with_inertial_parameters(loaded)
        self.load_max = largest_gravity_load(whole)
        self.inertia_max = _largest_inertia(whole, inertia)
        effort_max = config.column('effort_max')
        self._velocity_max = config.column('velocity_max')
        for joint, load in zip(config.joints, self.load_max.tolist(), strict=True):
            if joint.effort_max <= load:
                raise ValueError(
                    f'joint {joint.name}: effort_max = {joint.effort_max:g} Nm cannot carry the '
                    f'outstretched arm with its rated payload, which needs {load:.2f} Nm; check '
                    'effort_max, rated_payload and the URDF'
                )
        spare = _RELIABLE_SHARE * (effort_max - self.load_max) / self.inertia_max
        self.deceleration: Array = np.minimum(config.column('acceleration_max'), spare)

    @property
    def damping_min(self) -> Array:
        """Damping (n,) [Nms/rad] that keeps a falling arm slow; see the attributes of the class."""
        falling = self.load_max / (_FALLING_SHARE * self._velocity_max)
        least: Array = np.maximum(falling, self.inertia_max / _DAMPING_TIME)
        return least

    def at(self, q: Array, dq: Array, effort: Array) -> tuple[list[float], list[float]]:
        """Return the load torque [Nm] and the inertia [kg m^2] of each joint.

        The load is the torque of the arm's weight, of velocity terms, and of other joints'
        accelerations.

        Parameters
        ----------
        q, dq, effort
            (n,) positions [rad], velocities [rad/s] and acting torques [Nm].
        """
        acceleration = self._dynamics.forward(q, dq, effort)
        inertias = self._dynamics.inertia_matrix(q).diagonal()
        return (effort - inertias * acceleration).tolist(), inertias.tolist()


def _largest_inertia(robot: Robot, rotor_inertia: Array) -> Array:
    dynamics = Dynamics(robot, rotor_inertia)
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    inertias = [dynamics.inertia_matrix(q).diagonal() for q in postures]
    largest: Array = np.max(inertias, axis=0)
    return largest


# Speed limit of the barrier relative to the joint's speed limit; commands may reach the latter.
_SPEED_SHARE = 1.05
# The braking torque grows with the speed in excess of the barrier: full torque from this fraction
# of the speed limit, ...
_FULL_TORQUE_SHARE = 0.1
# ... limited to this rate [1/s] by a torque delay of up to 2 ms and by quantized speeds.
_FASTEST = 250.0
# Rate at which the joint approaches a position limit, relative to the rate at which it is held at
# the limit.
_APPROACH_SHARE = 0.25
# The unknown load is estimated from the joint's motion with this time constant [s], up to this
# fraction of the largest torque, ...
_DISTURBANCE_TIME = 5e-3
_DISTURBANCE_SHARE = 0.15
# ... and in part beyond it, while the joint is faster than this fraction of its limit and the load
# accelerates it. A base turned upside down, unknown to the bridge, changes a joint's load by twice
# the arm's weight. For a slow joint, encoder quantization has a similar effect, so the estimate
# decays with this time constant [s].
_TURNED_PART = 0.2
_TURNED_SHARE = 2.0  # relative to the largest torque, which holds the weight
_TURNED_SPEED_SHARE = 0.5
_TURNED_FADING = 0.03
# Between measurements farther apart than this [s] the acting torque is unknown.
_APART = 5e-3
_SPEED_NOISE = 0.15  # [rad/s] noise of a speed computed from counts, without its low-pass filter
# A joint whose motion overloads another joint is slowed to this fraction of its speed limit, at
# which it loads other joints by a tenth. The following times [s] are those of slowing down and of
# recovery.
_GIVE_WAY_SHARE = 0.3
_GIVE_WAY_TIME = 0.3
_RECOVERY_TIME = 1.0
# A delayed host leaves its last torque acting until the board's time-out. A torque that would
# accelerate the joint beyond this fraction of its speed limit is sent with board damping that
# prevents it. The speed filter limits that damping [1/s].
_GAP_SHARE = 1.1
# A later command may brake other joints with full torque, which loads this joint by up to this
# fraction of its torque and makes it faster by a twentieth of its speed limit.
_GAP_PULL_SHARE = 0.05
_GAP_FASTEST = 700.0
_GAP_ROOM_SHARE = 0.05  # fraction of the speed limit, for a joint that already has that speed
# A joint beyond its limit returns with at most this fraction of the speed limit.
_RETURN_SHARE = 0.05
# Largest sinking speed of a joint, relative to its speed limit, if the load exceeds the reduced
# torque of its warm motor.
_SINKING_SHARE = 0.1


class JointBarrier:
    """Torque bounds that keep a joint within its position and speed limits for one cycle.

    The barrier is the speed from which `deceleration` can still stop the joint before a position
    limit; it falls with the distance to the limit. A command passes if the joint can still brake
    after it. The torque of any other command is reduced to `highest` (or raised to `lowest`).
    A joint near the barrier is thus braked along the barrier; a joint beyond the barrier returns.
    Both bounds are computed for the state predicted at the time when the torque acts, because the
    measured speed is filtered and one cycle old.

    Plain floats are used, because they are faster than arrays for four joints.

    Parameters
    ----------
    joint
        Configuration with the limits of the joint.
    settings
        Settings; this class uses `period`, `soft_zone`, `velocity_lag` and `board_timeout`.
    deceleration
        Deceleration that the drive provides with any load [rad/s^2].
    inertia_max
        Largest inertia [kg m^2].

    Attributes
    ----------
    far
        Distance from a limit [rad] beyond which the limit does not slow the joint.
    q, dq, filtered
        Predicted position [rad], speed, and speed as filtered by the board [rad/s].
    inertia
        Inertia that the joint moves [kg m^2].
    load
        Load torque of the joint from the arm's weight and motion, plus the estimated unknown load
        [Nm].
    is_overwhelmed
        Whether the full drive torque cannot brake the joint as the barrier requires, because other
        joints' motion loads it too much.
    noise
        Error of the bounds caused by encoder quantization [Nm].
    lowest, highest
        Torque bounds for the coming cycle [Nm], not limited to the drive torque; the board
        saturates.
    is_released
        Whether the position limits are released because the motor is too warm to hold the joint
        there. The joint moves slowly beyond them, until its mechanical stop or its weight ends the
        motion.
    """

    def __init__(
        self, joint: JointConfig, settings: BridgeSettings, deceleration: float, inertia_max: float
    ) -> None:
        self._position_min, self._position_max = joint.position_min, joint.position_max
        self._effort_max = joint.effort_max
        self._unhindered = self._fastest = _SPEED_SHARE * joint.velocity_max
        self._return = _RETURN_SHARE * joint.velocity_max
        self._lag = settings.velocity_lag
        self._cycle = settings.period
        self._disturbance_max = _DISTURBANCE_SHARE * joint.effort_max
        self._turned_max = _TURNED_SHARE * joint.effort_max
        self._gap_time = settings.board_timeout
        self._gap_speed = _GAP_SHARE * joint.velocity_max
        self._gap_room_min = _GAP_ROOM_SHARE * joint.velocity_max
        self._gap_pull = _GAP_PULL_SHARE * joint.effort_max
        self.inertia = inertia_max
        self._gain_max = joint.effort_max / (_FULL_TORQUE_SHARE * joint.velocity_max)
        slowest = min(_FASTEST, self._gain_max / inertia_max)
        self._approach = min(joint.velocity_max / settings.soft_zone, _APPROACH_SHARE * slowest)
        self._deceleration = deceleration
        self._corner = deceleration / self._approach**2
        self.far = self._fastest / self._approach
        if self.far > self._corner:
            self.far = self._fastest**2 / (2.0 * deceleration) + 0.5 * self._corner
        self._kept, self._kept_time = 1.0, 0.0
        self._acceleration, self._kept_acceleration = 0.0, nan
        self._allowed = self._unhindered
        self.is_overwhelmed = self.is_released = False
        self.q = self.dq = self.filtered = self.load = self.noise = self.lowest = self.highest = 0.0
        self._modelled_load = 0.0
        self.restart()

    def restart(self) -> None:
        """Reset the estimate of the joint's motion; the next measured speed is used as it is."""
        self._is_known = False  # previous speed and load
        self._fastest = self._unhindered
        self._disturbance = self._turned = 0.0

    @property
    def is_slowed(self) -> bool:
        """Whether the speed limit is lowered, for another joint's sake or for its warm motor."""
        return self._fastest < self._unhindered or self._allowed < self._unhindered

    def lower_speed_limit(self, interval: float) -> None:
        """Lower the speed limit by the step of one `interval` [s], as a joint is overloaded."""
        least = _GIVE_WAY_SHARE * self._unhindered
        self._fastest = max(self._fastest - self._unhindered * interval / _GIVE_WAY_TIME, least)

    def recover(self, interval: float) -> None:
        """Move a lowered speed limit towards its normal value, by the step of one `interval`."""
        if self._fastest > self._allowed:
            less = self._fastest - self._unhindered * interval / _GIVE_WAY_TIME
            self._fastest = max(less, self._allowed)
            return
        more = self._fastest + self._unhindered * interval / _RECOVERY_TIME
        self._fastest = min(more, self._allowed)

    def limit_speed(self, sinks: bool) -> None:
        """Set the allowed speed: the limit, or a small fraction if the overloaded joint sinks."""
        self._allowed = (_SINKING_SHARE if sinks else 1.0) * self._unhindered

    def speed(self, distance: float) -> float:
        """Return the allowed speed [rad/s] at a distance [rad] from a position limit."""
        if self.is_released:
            return min(self._return, self._fastest)
        if distance >= self.far:
            return self._fastest
        if distance < self._corner:
            speed = self._approach * distance
            return -self._return if speed < -self._return else speed
        reachable = sqrt(2.0 * self._deceleration * (distance - 0.5 * self._corner))
        return min(reachable, self._fastest)

    def update(
        self,
        q: float,
        dq: float,
        effort: float,
        load: float,
        inertia: float,
        age: float,
        interval: float,
        kept: float = nan,
        was_kept: bool = False,
    ) -> None:
        """Compute the joint's torque bounds for the coming cycle.

        Parameters
        ----------
        q, dq
            Last measured position [rad] and filtered speed [rad/s].
        effort
            Joint torque that has acted since the measurement [Nm].
        load, inertia
            Load torque of the arm's weight and motion [Nm], and moved inertia [kg m^2].
        age
            Time since the measurement [s].
        interval
            Time between the last two measurements [s]; 0 if none has arrived since the last call,
            inf if there was no earlier one.
        kept
            Joint torque that has acted in place of `effort` if the last command was lost, so that
            the board still uses an older command [Nm]. NaN while the board loses no command.
        was_kept
            Whether the board also used an older command between the last two measurements.
        """
        if interval > 0.0 or not self._is_known:
            if was_kept:
                self._acceleration = self._kept_acceleration
            speed = dq
            if self._is_known and interval <= _APART and self._acceleration == self._acceleration:
                speed = self._without_lag(dq, interval)
                self._observe(speed, inertia, interval)
            self._last_speed, self._speed = dq, speed
            self._is_known = True
        self.inertia, self._modelled_load = inertia, load
        self.load = load = load + self._disturbance + self._turned
        gain = _FASTEST * inertia
        if not gain < self._gain_max:
            gain = self._gain_max
        self.noise = _SPEED_NOISE * gain
        self._acceleration = (effort - load) / inertia
        self._kept_acceleration = (kept - load) / inertia
        self._predict(self._acceleration, q, dq, age, gain)
        if kept == kept:
            likely = self.q, self.dq, self.filtered
            highest, lowest = self.highest, self.lowest
            self._predict(self._kept_acceleration, q, dq, age, gain)
            self.highest, self.lowest = min(highest, self.highest), max(lowest, self.lowest)
            if abs(likely[1]) > abs(self.dq):
                self.q, self.dq, self.filtered = likely
        most = self._effort_max
        self.is_overwhelmed = self.lowest > most or self.highest < -most

    def _predict(self, acceleration: float, q: float, dq: float, age: float, gain: float) -> None:
        """Predict the present joint state from the last measurement; compute torque bounds."""
        # After a pause of the host, the torque that the board has produced is unknown.
        gained = (_APART if age > _APART else age) * acceleration
        mean = self._speed + 0.5 * gained
        self.q = q + age * mean
        self.dq = self._speed + gained
        self.filtered = mean + self._share_kept(age) * (dq - mean)
        load, inertia = self.load, self.inertia
        self.highest = load + self._bound(self._position_max - self.q, self.dq, gain, inertia)
        self.lowest = load - self._bound(self.q - self._position_min, -self.dq, gain, inertia)

    def gap_damping(
        self, torque: float, law: float = 0.0, stiffness: float = 0.0, damping: float = 0.0
    ) -> float:
        """Return the board damping [Nms/rad] that limits the speed while commands are missing.

        The result is 0 if the joint stays slow enough until `board_timeout` without additional
        damping: because the torque is small, the board's own damping ends the motion, or the
        stiffness stores little energy. The damping is computed for the modelled load, and for the
        modelled load plus the small estimated disturbance; the larger value is returned. The
        large disturbance estimated for a base turned upside down is not used, because it may be
        as large as the torque.

        Parameters
        ----------
        torque
            Torque of the present command [Nm].
        law, stiffness, damping
            Torque of the board's law without saturation [Nm], and its decrease with position
            [Nm/rad] and speed [Nms/rad].
        """
        margin, pull, slack = self._disturbance_max, self._gap_pull, self._gap_room_min
        inertia, stiffness, time = self.inertia, stiffness * self.inertia, self._gap_time
        needed = 0.0
        for load in (self._modelled_load, self._modelled_load + self._disturbance):
            speed, excess, wanted = self.dq, torque - load, law - load
            if excess < 0.0:
                speed, excess, wanted = -speed, -excess, -wanted
            if damping > 0.0 and abs(speed) > _TURNED_SPEED_SHARE * self._unhindered:
                # With weak damping, the braking of other joints would accelerate a fast joint.
                if speed > 0.0:
                    excess, wanted = excess + margin, wanted + margin
                elif excess < margin:
                    speed, excess, wanted = -speed, margin - excess, margin - wanted
            if (excess + pull) * time <= (self._gap_speed - speed) * inertia:
                continue
            # Without external load the joint reaches the intended speed, with one slightly more.
            for speed_max, pulled in ((self._gap_speed, 0.0), (self._gap_speed + slack, pull)):
                room, force, requested = speed_max - speed, excess + pulled, wanted + pulled
                if (
                    force * time > room * inertia
                    and requested >= room * damping
                    and requested * requested >= (speed_max + speed) * room * stiffness
                ):
                    needed = max(needed, force / max(room, slack))
        return min(needed, _GAP_FASTEST * inertia) if needed else 0.0

    def mean_filtered(self, torque: float) -> float:
        """Return the mean filtered speed [rad/s] in a cycle with a given torque [Nm]."""
        cycle = self._cycle
        time = cycle / self._lag
        followed = 1.0 - (1.0 - self._share_kept(cycle)) / time
        gained = (torque - self.load) / self.inertia * cycle * (0.5 - followed / time)
        return self.filtered + followed * (self.dq - self.filtered) + gained

    def _observe(self, speed: float, inertia: float, interval: float) -> None:
        """Estimate the unknown load from the change of speed [rad/s] in `interval` [s]."""
        missing = inertia * (self._acceleration - (speed - self._speed) / interval)
        learned = self._disturbance + interval / (_DISTURBANCE_TIME + interval) * missing
        largest = self._disturbance_max
        self._disturbance = (
            -largest if learned < -largest else largest if learned > largest else learned
        )
        if abs(speed) > _TURNED_SPEED_SHARE * self._unhindered:
            turned = self._turned + _TURNED_PART * (learned - self._disturbance)
            largest = self._turned_max
            self._turned = (
                -largest if turned < -largest else largest if turned > largest else turned
            )
        else:
            self._turned *= _TURNED_FADING / (_TURNED_FADING + interval)

    def _without_lag(self, dq: float, interval: float) -> float:
        """Return the present speed [rad/s] without the lag of the board's low-pass filter."""
        kept = self._share_kept(interval)
        mean = (dq - kept * self._last_speed) / (1.0 - kept)
        # The filter weights recent values more; the torque of that cycle predicts the remaining
        # lag.
        age = self._lag - interval * kept / (1.0 - kept)
        return mean + age * self._acceleration

    def _share_kept(self, time: float) -> float:
        """Return the weight of the old speed in the board's low-pass filter after `time` [s]."""
        if not abs(time - self._kept_time) < 1e-7:  # stored, because most cycles have equal length
            self._kept, self._kept_time = exp(-time / self._lag), time
        return self._kept

    def _bound(self, distance: float, speed: float, gain: float, inertia: float) -> float:
        """Return the largest torque [Nm] allowed towards a limit, in addition to the load."""
        if distance >= self.far and not self.is_released:  # the usual case
            return gain * (self._fastest - speed)
        allowed = self.speed(distance)
        if allowed >= self._fastest or speed <= 0.0 or self.is_released:
            braking = 0.0
        elif distance < self._corner:
            braking = self._approach * speed
        else:
            braking = self._deceleration / allowed * speed
        return gain * (allowed - speed) - inertia * braking
