"""A motor's encoder and the speed that a board's firmware makes of it."""

from math import exp, floor, pi

COUNTS_PER_TURN = 4096
RAD_PER_COUNT = 2.0 * pi / COUNTS_PER_TURN
_COUNTS_PER_RAD = COUNTS_PER_TURN / (2.0 * pi)
_VELOCITY_BANDWIDTH = 2.0 * pi * 100.0  # [rad/s] low-pass of the firmware


class EmulatedEncoder:
    """An encoder of a motor: quantised angle, filtered speed, one index pulse a turn.

    Parameters
    ----------
    substep
        Time between two samples [s].
    zero
        True motor angle [rad] at which the count is zero; where it is first sampled if None.
    absolute
        Whether it knows its angle after a restart; else it counts from where it is then.
    pulse_offset
        True motor angle of an index pulse, modulo one turn [rad].

    Attributes
    ----------
    position, velocity
        What the firmware measures [rad], [rad/s].
    index_detected, index_toggle
        Set at the first index pulse; flips at each one.
    stuck
        Fault: the count no longer changes.
    """

    def __init__(
        self,
        substep: float,
        zero: float | None = 0.0,
        absolute: bool = False,
        pulse_offset: float = 0.0,
    ) -> None:
        self._substep = substep
        self._gain = 1.0 - exp(-_VELOCITY_BANDWIDTH * substep)
        self._shift = 0.0 if zero is None else -zero
        self._begins = zero is None  # to count where it is first sampled
        self._shift_absolute = self._shift if absolute else None
        self._pulse_offset = pulse_offset
        self._angle: float | None = None
        self._turn = 0
        self.position = 0.0
        self.velocity = 0.0
        self.index_detected = False
        self.index_toggle = False
        self.stuck = False

    def sample(self, angle: float, compensate_index: bool = False) -> None:
        """Measure a true motor angle [rad].

        With `compensate_index`, the next index pulse makes the position jump so that the
        pulse lies at zero, as the firmware's index offset compensation does.
        """
        if self._angle is None:
            self.place(angle)
        if self.stuck and self._angle is not None:
            angle = self._angle
        self._angle = angle
        turn = self._turns(angle)
        if turn != self._turn:
            self._pass_index(max(turn, self._turn), compensate_index)
            self._turn = turn
        position = self._quantised(angle)
        self.velocity += self._gain * ((position - self.position) / self._substep - self.velocity)
        self.position = position

    def place(self, angle: float) -> None:
        """Go to a true motor angle [rad] unseen, as if turned there between two samples."""
        if self._begins:
            self._shift, self._begins = -angle, False
        self._angle = angle
        self._turn = self._turns(angle)
        self.position = self._quantised(angle)
        self.velocity = 0.0

    def remount(self, angle: float) -> None:
        """Go on counting on another shaft, which is at an angle [rad]."""
        if self._angle is None:
            return  # it has not begun
        self._shift += self._angle - angle
        self._angle = angle
        self._turn = self._turns(angle)

    def restart(self) -> None:
        """Begin to count, with no pulse met: the supply was off and on."""
        angle = self._angle or 0.0
        self._shift = -angle if self._shift_absolute is None else self._shift_absolute
        self.position, self.velocity = self._quantised(angle), 0.0
        self.index_detected = self.index_toggle = self.stuck = False

    def jump(self, angle: float) -> None:
        """Fault: add an angle [rad] to the count at once, as lost or doubled pulses would."""
        self._shift += angle

    def _pass_index(self, turn: int, compensate: bool) -> None:
        if compensate and not self.index_detected:
            shift = -2.0 * pi * turn - self._pulse_offset
            self.position += shift - self._shift  # the firmware's speed does not see this jump
            self._shift = shift
        self.index_detected = True
        self.index_toggle = not self.index_toggle

    def _turns(self, angle: float) -> int:
        """Return how many index pulses lie below a true motor angle [rad], from the offset on."""
        return floor((angle - self._pulse_offset) / (2.0 * pi))

    def _quantised(self, angle: float) -> float:
        return floor((angle + self._shift) * _COUNTS_PER_RAD) * RAD_PER_COUNT
