"""Finds the encoders' zeros by their index pulses."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_buffer import Array, CommandBuffer, Mask
from aerarm_ros.model.drive_train import DriveTrain

_SPEED = 0.15  # [rad/s] at the joint
_REACH = 0.6  # of a motor turn, to either side
_TURN = 2.0 * np.pi


class Homing:
    """Turns every motor slowly until its index pulse, which fixes the encoder's zero.

    An incremental encoder counts from where it was switched on; its index pulse comes once
    a motor turn, at multiples of 2 pi of the motor angle. Which multiple follows from the
    posture: the arm must start within a third of a motor turn (about 4 degrees at the joint)
    of the configuration's rest position. Each motor searches 0.6 turns one way, then as far
    the other way.

    The boards' own index offset compensation is not used: it makes the position jump under
    the control law, so that the motor jerks. Here the master notes the position at the
    pulse, to within the 1 ms between two frames, and corrects it afterwards.

    Parameters
    ----------
    config
        The arm.
    position
        (n,) motor angles as reported at the start [rad].
    toggles
        (n,) the index bits at the start, which flip at each pulse.

    Attributes
    ----------
    command
        What the joints shall do now.
    fault
        What went wrong, or ''.
    """

    def __init__(self, config: ArmConfig, position: Array, toggles: Mask) -> None:
        self.command = CommandBuffer.standstill(config.n)
        self.fault = ''
        self._names = config.joint_names
        drive = DriveTrain(config)
        self._expected = drive.joint_to_motor_position(np.array(config.rest_position))
        self._sign = config.column('sign')
        self._start = position.copy()
        self._toggles = toggles.copy()
        self._direction = np.ones(config.n)
        self._found = np.zeros(config.n, dtype=bool)
        self._zero = np.zeros(config.n)

    @property
    def is_done(self) -> bool:
        """Whether every index was found, or the search has failed."""
        return bool(self._found.all()) or bool(self.fault)

    @property
    def zero(self) -> Array:
        """(n,) angles [rad] that the boards report where the motors' angle is zero."""
        return self._zero.copy()

    def update(self, position: Array, toggles: Mask) -> None:
        """Take (n,) reported motor angles [rad] and index bits, and set the next command."""
        met = (toggles != self._toggles) & ~self._found
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
