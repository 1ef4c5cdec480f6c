"""A motor's encoder and the speed that a board's firmware makes of it."""

from math import exp, floor, pi

COUNTS_PER_TURN = 4096
RAD_PER_COUNT = 2.0 * pi / COUNTS_PER_TURN
_COUNTS_PER_RAD = COUNTS_PER_TURN / (2.0 * pi)
_VELOCITY_BANDWIDTH = 2.0 * pi * 100.0  # [rad/s] low-pass of the firmware


class EmulatedEncoder:
    """An incremental encoder: quantised angle, filtered speed, one index pulse a turn.

    Parameters
    ----------
    substep
        Time between two samples [s].
    zero
        True motor angle [rad] at which the count is zero.

    Attributes
    ----------
    position, velocity
        What the firmware measures [rad], [rad/s].
    index_detected, index_toggle
        Set at the first index pulse; flips at each one.
    stuck
        Fault: the count no longer changes.
    """

    def __init__(self, substep: float, zero: float = 0.0) -> None:
        self._substep = substep
        self._gain = 1.0 - exp(-_VELOCITY_BANDWIDTH * substep)
        self._shift = -zero
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
        turn = floor(angle / (2.0 * pi))
        if turn != self._turn:
            self._pass_index(max(turn, self._turn), compensate_index)
            self._turn = turn
        position = self._quantised(angle)
        self.velocity += self._gain * ((position - self.position) / self._substep - self.velocity)
        self.position = position

    def place(self, angle: float) -> None:
        """Go to a true motor angle [rad] unseen, as if turned there between two samples."""
        self._angle = angle
        self._turn = floor(angle / (2.0 * pi))
        self.position = self._quantised(angle)
        self.velocity = 0.0

    def restart(self) -> None:
        """Count from zero where it is, with no pulse met: the supply was off and on."""
        self._shift = -(self._angle or 0.0)
        self.position = self.velocity = 0.0
        self.index_detected = self.index_toggle = self.stuck = False

    def jump(self, angle: float) -> None:
        """Fault: add an angle [rad] to the count at once, as lost or doubled pulses would."""
        self._shift += angle

    def _pass_index(self, turn: int, compensate: bool) -> None:
        if compensate and not self.index_detected:
            shift = -2.0 * pi * turn
            self.position += shift - self._shift  # the firmware's speed does not see this jump
            self._shift = shift
        self.index_detected = True
        self.index_toggle = not self.index_toggle

    def _quantised(self, angle: float) -> float:
        return floor((angle + self._shift) * _COUNTS_PER_RAD) * RAD_PER_COUNT
