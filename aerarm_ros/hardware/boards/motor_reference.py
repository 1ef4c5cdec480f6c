"""What one motor's board is asked to do."""

from collections import deque
from math import inf, nan

from aerarm_ros.hardware.gate.joint_barrier import JointBarrier

_SENT_KEPT = 512  # references; a board goes on alone for 0.255 s at most, a cycle lasts 0.5 ms


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
    effort_limit
        Largest torque of the joint that a reference may ask for [Nm]; braking may use all of
        `effort_max`.
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
        '_most',
        '_reach',
        '_sent',
        '_slope',
        'believed',
        'current',
        'current_max',
        'effort_limit',
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
        self._most = self.effort_limit = effort_max
        self.zero = self.integral = 0.0
        self._sent: deque[tuple[float, float, float, float, float, float]] = deque(
            maxlen=_SENT_KEPT
        )
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
        self._most = self._effort_max
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
        return self._limited(self._law(self._reference(), q, dq))

    def note_sent(self) -> None:
        """Remember the references, which a frame has taken to the board or was to take."""
        self._sent.append(self._reference())

    def kept_torque(self, q: float, dq: float, unconfirmed: int) -> float:
        """Return the joint torque [Nm] if the last commands do not arrive.

        The board then goes on with the one that is `unconfirmed` commands older than the last.
        """
        sent = self._sent
        return self._limited(self._law(sent[-1 - min(unconfirmed, len(sent) - 1)], q, dq))

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
        self._most = self.effort_limit
        is_reduced = self._most < self._effort_max
        self.current_max = abs(self._current_per_effort) * self._most if is_reduced else inf
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
        about the speed that the joint will have until the next frame. So does the torque that other
        references make now, if their stiffness would make the joint too fast by then.

        Else the torque is the barrier's, put as a speed that the board damps to: it can be said
        without a feed-forward current, and while it is held the joint's own speed lowers it.

        Returns
        -------
        bool
            Whether the joint is braked.
        """
        q, dq = barrier.q, barrier.filtered
        law = self._law(self._reference(), q, dq)
        asked = self._limited(law)
        if barrier.lowest <= asked <= barrier.highest:
            gap = self._gap_kd(barrier, asked, law)
            if self.kp == 0.0 and self.kd == 0.0:
                self.kd = gap
                self.velocity = self._slope * barrier.mean_filtered(asked) if gap else 0.0
            elif gap:
                # It falls as the joint gets faster, as under the law that it stands for.
                self.kp = self.integral_gain = self.current = 0.0
                self.kd = max(gap, self.kd)
                self.velocity = self._slope * dq + asked * self._current_per_effort / self.kd
            return False
        allowed = barrier.highest if asked > barrier.highest else barrier.lowest
        if self._most < self._effort_max:  # a reduced torque is no reason to break a limit
            self._most, self.current_max = self._effort_max, inf
        torque = self._limited(allowed)
        if self._integrates and self.kp > 0.0:
            # The integral of a velocity reference does not wind up.
            excess = (asked - torque) * self._current_per_effort / (self.kp * self._slope)
            self.joint_position -= excess
        self.kp = self.kd = self.integral_gain = self.current = 0.0
        gap = self._gap_kd(barrier, torque, torque)
        self.kd = max(self._braking_kd, gap)
        self.believed = barrier.load * self._current_per_effort
        self.noise = barrier.noise * abs(self._current_per_effort)
        self.position = self._slope * q + self._intercept + self.zero
        about = barrier.mean_filtered(torque) if gap else dq
        self.velocity = self._slope * about + torque * self._current_per_effort / self.kd
        return True

    def _gap_kd(self, barrier: JointBarrier, torque: float, law: float) -> float:
        """Return the board's damping [A s/rad] for a torque [Nm] that a held up host leaves."""
        per_gain = abs(self._slope / self._current_per_effort)
        damping = barrier.gap_damping(torque, law, self.kp * per_gain, self.kd * per_gain)
        return min(damping / per_gain, self._kd_max)

    def _reference(self) -> tuple[float, float, float, float, float, float]:
        """Return what a frame says of the motor, as `_law` takes it."""
        return self.position, self.velocity, self.current, self.kp, self.kd, self.integral_gain

    def _law(
        self, reference: tuple[float, float, float, float, float, float], q: float, dq: float
    ) -> float:
        """Return the joint torque [Nm] of the board's law under a reference, without limits."""
        position, velocity, current, kp, kd, integral_gain = reference
        error = position - self.zero - self._slope * q - self._intercept
        current += kp * error + kd * (velocity - self._slope * dq)
        if integral_gain:
            current += self.integral
        return current / self._current_per_effort

    def _limited(self, torque: float) -> float:
        return min(max(torque, -self._most), self._most)

    def _error(self, q: float) -> float:
        """Return how far the motor is from its reference [rad] with the joint at q [rad]."""
        return self.position - self.zero - self._slope * q - self._intercept

    def _integrated(self, step: float, q: float) -> float:
        """Return the last reference moved on by a step [rad], within reach and limits."""
        last = self.joint_position
        wanted = (last if last == last else q) + step
        near = min(max(wanted, q - self._reach), q + self._reach)
        return min(max(near, self._lowest), self._highest)
