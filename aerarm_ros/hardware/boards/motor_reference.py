"""What one motor's board is asked to do."""

from math import inf, nan

from aerarm_ros.hardware.gate.joint_barrier import JointBarrier


class MotorReference:
    """Reference and gains of one motor, as the board's law (4.4) takes them.

    Plain numbers, not arrays: for four joints that is faster, and NaN means unused.

    Parameters
    ----------
    slope, intercept
        Motor angle [rad] = slope * joint angle [rad] + intercept.
    current_per_effort
        [A/Nm].
    position_min, position_max
        Limits of the joint [rad].
    effort_max
        Largest torque of the joint [Nm].
    braking_kd
        Damping with which a joint is braked, whatever gains are set [A s/rad].
    kd_max
        Largest damping that a frame holds [A s/rad].

    Attributes
    ----------
    position, velocity, current, kp, kd, integral_gain
        As in `BoardCommand`: [rad], [rad/s], [A], [A/rad], [A s/rad], [A/(rad s)].
    believed
        Current that a load explains, however the joint moves [A]: the effort commanded, or what
        a braked joint carries.
    noise
        Current that the encoder's counts make of the torque of a braked joint [A]; 0 if it is not
        braked.
    current_max
        Largest current that it may take besides the board's own limit [A].
    zero
        Angle [rad] that the board reports where the motor's angle is zero.
    integral
        What the board's integral term makes of the current while its gain is not 0 [A], as far as
        the references and the measured angles tell.
    joint_position
        Position reference at the joint [rad], NaN if there is none.
    """

    __slots__ = (
        '_board_integral_gain',
        '_board_kd',
        '_board_kp',
        '_braking_kd',
        '_current_per_effort',
        '_effort_max',
        '_highest',
        '_integrates',
        '_intercept',
        '_kd_max',
        '_lowest',
        '_reach',
        '_slope',
        'believed',
        'current',
        'current_max',
        'integral',
        'integral_gain',
        'joint_position',
        'kd',
        'kp',
        'noise',
        'position',
        'velocity',
        'zero',
    )

    def __init__(
        self,
        slope: float,
        intercept: float,
        current_per_effort: float,
        position_min: float,
        position_max: float,
        effort_max: float,
        braking_kd: float,
        kd_max: float,
    ) -> None:
        self._slope, self._intercept = slope, intercept
        self._current_per_effort = current_per_effort
        self._lowest, self._highest = position_min, position_max
        self._effort_max, self._braking_kd, self._kd_max = effort_max, braking_kd, kd_max
        self.zero = self.integral = 0.0
        self.set_gains(0.0, 0.0, 0.0, 0.0)
        self.release()

    def set_gains(self, kp: float, kd: float, integral_gain: float, reach: float) -> None:
        """Set the board's gains, units as above.

        `reach` is the largest distance of an integrated reference from the joint [rad].
        """
        self._board_kp, self._board_kd = kp, kd
        self._board_integral_gain = integral_gain
        self._reach = reach

    def set_zero(self, zero: float) -> None:
        """Change `zero` [rad] without moving the motor: the joint's angle changes instead."""
        self.joint_position += (self.zero - zero) / self._slope
        self.zero = zero

    def release(self) -> None:
        """Ask for nothing: no current, no gains."""
        self.position = self.velocity = self.current = 0.0
        self.kp = self.kd = self.integral_gain = self.believed = self.noise = 0.0
        self.current_max = inf
        self.joint_position = nan
        self._integrates = False

    def damp(self, speed_max: float = inf) -> None:
        """Ask for no current but what brakes the joint to rest, from a motor speed [rad/s]."""
        self.release()
        self.kd = self._board_kd
        if speed_max < inf:
            self.current_max = self.kd * speed_max

    def torque(self, q: float, dq: float) -> float:
        """Return the joint torque [Nm] of the board's law for a joint at q [rad], dq [rad/s]."""
        slip = self.velocity - self._slope * dq
        current = self.kp * self._error(q) + self.kd * slip + self.current
        if self.integral_gain:
            current += self.integral
        return min(max(current / self._current_per_effort, -self._effort_max), self._effort_max)

    def wind_up(self, q: float, duration: float) -> None:
        """Follow the board's integral for a time [s], with the joint at q [rad] in its middle."""
        if self.integral_gain:
            most = abs(self._current_per_effort) * self._effort_max
            wound = self.integral + self.integral_gain * self._error(q) * duration
            self.integral = min(max(wound, -most), most)

    def track(self, position: float, velocity: float, effort: float, q: float, dt: float) -> None:
        """Follow a limited reference; arguments as in `MotorReferences.track`, for one joint."""
        stiff = position == position or velocity == velocity
        speed = velocity if velocity == velocity else 0.0
        self.current_max = inf
        if position == position:
            reference = position
        elif stiff:
            reference = self._integrated(speed * dt, q)
        else:
            reference = q  # without stiffness, but any frame can hold it
        self.joint_position = reference if stiff else nan
        self.kp = self._board_kp if stiff else 0.0
        self.kd = self._board_kd if stiff else 0.0
        self.integral_gain = self._board_integral_gain if stiff else 0.0
        self._integrates = stiff and position != position
        self.position = self._slope * reference + self._intercept + self.zero
        self.velocity = self._slope * speed
        self.current = self._current_per_effort * effort if effort == effort else 0.0
        self.believed, self.noise = self.current, 0.0

    def keep_within(self, barrier: JointBarrier) -> bool:
        """Brake the joint instead if the references ask for more than a barrier lets pass.

        A torque alone that passes, but would be too much if the host were held up, gets a damping
        about the speed that the joint will have until the next frame.

        Else the torque is the barrier's, put as a speed that the board damps to: it can be said
        without a feed-forward current, and while it is held the joint's own speed lowers it.

        Returns
        -------
        bool
            Whether the joint is braked.
        """
        q, dq = barrier.q, barrier.filtered
        asked = self.torque(q, dq)
        if barrier.lowest <= asked <= barrier.highest:
            if self.kp == 0.0 and self.kd == 0.0 and not self.integral_gain:
                self.kd = self._gap_kd(barrier, asked)
                self.velocity = self._slope * barrier.mean_filtered(asked) if self.kd else 0.0
            return False
        allowed = barrier.highest if asked > barrier.highest else barrier.lowest
        torque = min(max(allowed, -self._effort_max), self._effort_max)
        if self._integrates and self.kp > 0.0:
            # The integral of a velocity reference does not wind up.
            excess = (asked - torque) * self._current_per_effort / (self.kp * self._slope)
            self.joint_position -= excess
        self.kp = self.integral_gain = self.current = 0.0
        gap = self._gap_kd(barrier, torque)
        self.kd = max(self._braking_kd, gap)
        self.believed = barrier.load * self._current_per_effort
        self.noise = barrier.noise * abs(self._current_per_effort)
        self.position = self._slope * q + self._intercept + self.zero
        about = barrier.mean_filtered(torque) if gap else dq
        self.velocity = self._slope * about + torque * self._current_per_effort / self.kd
        return True

    def _gap_kd(self, barrier: JointBarrier, torque: float) -> float:
        """Return the board's damping [A s/rad] for a torque [Nm] that a held up host leaves."""
        damping = barrier.gap_damping(torque)
        return min(damping * abs(self._current_per_effort / self._slope), self._kd_max)

    def _error(self, q: float) -> float:
        """Return how far the motor is from its reference [rad] with the joint at q [rad]."""
        return self.position - self.zero - self._slope * q - self._intercept

    def _integrated(self, step: float, q: float) -> float:
        """Return the last reference moved on by a step [rad], within reach and limits."""
        last = self.joint_position
        wanted = (last if last == last else q) + step
        near = min(max(wanted, q - self._reach), q + self._reach)
        return min(max(near, self._lowest), self._highest)
