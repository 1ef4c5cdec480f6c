"""Finds the encoders' zeros by their index pulses."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_buffer import Array, CommandBuffer, Mask

_SPEED = 0.15  # [rad/s] at the joint
_REACH = 0.6  # of a motor turn, to either side
_TURN = 2.0 * np.pi
_BLURRED = 2.5  # times the usual interval, in which a pulse's place is not known well enough
_REPEATS_MAX = 20


class Homing:
    """Turns every motor slowly until its index pulse, which fixes the encoder's zero.

    An incremental encoder counts from where it was switched on; its index pulse comes once
    a motor turn, at multiples of 2 pi of the motor angle. Which multiple follows from the
    posture: the arm must start within a third of a motor turn (about 4 degrees at the joint)
    of the configuration's rest position. Each motor searches 0.6 turns one way, then as far
    the other way.

    The boards' own index offset compensation is not used: it makes the position jump under
    the control law, so that the motor jerks. Here the master notes the position at the
    pulse, to within the 1 ms between two frames, and corrects it afterwards. A pulse that was met
    while the host was held up lies somewhere in what the motor turned meanwhile: it is searched
    once more, the other way.

    Parameters
    ----------
    config
        The arm.
    position
        (n,) motor angles as reported at the start [rad].
    toggles
        (n,) the index bits at the start, which flip at each pulse.
    expected
        (n,) what the motors' angles are at the start, to within a third of a turn [rad].

    Attributes
    ----------
    command
        What the joints shall do now.
    fault
        What went wrong, or ''.
    """

    def __init__(self, config: ArmConfig, position: Array, toggles: Mask, expected: Array) -> None:
        self.command = CommandBuffer.standstill(config.n)
        self.fault = ''
        self._names = config.joint_names
        self._expected = expected.copy()
        self._sign = config.column('sign')
        self._start = position.copy()
        self._toggles = toggles.copy()
        self._direction = np.ones(config.n)
        self._found = np.zeros(config.n, dtype=bool)
        self._zero = np.zeros(config.n)
        self._usual_interval = np.inf
        self._repeats = 0

    @property
    def is_done(self) -> bool:
        """Whether every index was found, or the search has failed."""
        return bool(self._found.all()) or bool(self.fault)

    @property
    def zero(self) -> Array:
        """(n,) angles [rad] that the boards report where the motors' angle is zero."""
        return self._zero.copy()

    def update(self, position: Array, toggles: Mask, interval: Array | float = 0.0) -> None:
        """Set the next command.

        Parameters
        ----------
        position
            (n,) reported motor angles [rad].
        toggles
            (n,) index bits.
        interval
            (n,) or one for all: time since the last measurement [s].
        """
        self._usual_interval = min(self._usual_interval, float(np.min(interval)))
        met = (toggles != self._toggles) & ~self._found
        blurred = met & (interval > _BLURRED * self._usual_interval)
        if blurred.any():
            self._search_again(blurred, toggles)
            met &= ~blurred
        for i in np.flatnonzero(met):
            angle = position[i] - self._start[i] + self._expected[i]
            self._zero[i] = position[i] - _TURN * round(angle / _TURN)
        self._found |= met
        travel = (position - self._start) / _TURN
        missed = ~self._found & (travel < -_REACH)
        self._direction[travel > _REACH] = -1.0
        if missed.any():
            names = ', '.join(name for name, no in zip(self._names, missed, strict=True) if no)
            self.fault = (
                f'homing found no index pulse of {names} within a motor turn: check the encoder '
                'cable'
            )
        speed = np.where(self._found, 0.0, _SPEED * self._direction)
        self.command.dq[:] = self._sign * speed

    def _search_again(self, blurred: Mask, toggles: Mask) -> None:
        self._direction[blurred] *= -1.0
        self._toggles[blurred] = toggles[blurred]
        self._repeats += 1
        if self._repeats > _REPEATS_MAX:
            self.fault = (
                f'homing was held up at {self._repeats} index pulses, so their place is not known: '
                'check what else the host does'
            )
