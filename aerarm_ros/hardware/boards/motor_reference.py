"""What one motor's board is asked to do."""

from math import nan


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

    Attributes
    ----------
    position, velocity, current, kp, kd, integral_gain
        As in `BoardCommand`: [rad], [rad/s], [A], [A/rad], [A s/rad], [A/(rad s)].
    zero
        Angle [rad] that the board reports where the motor's angle is zero.
    joint_position
        Position reference at the joint [rad], NaN if there is none.
    """

    __slots__ = (
        '_board_integral_gain',
        '_board_kd',
        '_board_kp',
        '_current_per_effort',
        '_highest',
        '_intercept',
        '_lowest',
        '_reach',
        '_slope',
        'current',
        'integral_gain',
        'joint_position',
        'kd',
        'kp',
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
    ) -> None:
        self._slope, self._intercept = slope, intercept
        self._current_per_effort = current_per_effort
        self._lowest, self._highest = position_min, position_max
        self.zero = 0.0
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
        self.kp = self.kd = self.integral_gain = 0.0
        self.joint_position = nan

    def damp(self) -> None:
        """Ask for no current but what brakes the joint to rest."""
        self.release()
        self.kd = self._board_kd

    def track(
        self, position: float, velocity: float, effort: float, brake: float, q: float, dt: float
    ) -> None:
        """Follow a limited reference; arguments as in `MotorReferences.track`, for one joint."""
        stiff = position == position or velocity == velocity
        speed = velocity if velocity == velocity else 0.0
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
        if brake == brake:
            speed, self.kd = brake, self._board_kd
        self.position = self._slope * reference + self._intercept + self.zero
        self.velocity = self._slope * speed
        self.current = self._current_per_effort * effort if effort == effort else 0.0

    def _integrated(self, step: float, q: float) -> float:
        """Return the last reference moved on by a step [rad], within reach and limits."""
        last = self.joint_position
        wanted = (last if last == last else q) + step
        near = min(max(wanted, q - self._reach), q + self._reach)
        return min(max(near, self._lowest), self._highest)
