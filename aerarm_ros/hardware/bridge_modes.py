"""Modes of the bridge and its answers to requests.

- disconnected: a board does not answer.
- idle: the boards answer and the motors are off.
- unhomed: the motors are off, and the encoder zero of a joint is unknown. Only `home` and
  commissioning move the arm.
- aligning: the boards turn their motors to find the rotor angles. The arm moves.
- ready: the arm holds its position; no command has arrived yet.
- homing: the motors search for the encoders' index pulses.
- commissioning: one motor turns its joint at low torque and speed; all other motors are off.
- running: the arm follows the last command.
- damping: the last command is too old, and no `hold` request is active. The joints are damped, so
  the arm sinks slowly. The arm follows the next valid command; `enable` or `hold` make it hold its
  position.
- fault: the arm is stopped for the reason given by `faults`. Joints with a working board and
  encoder are damped until `clear_fault`.
"""

from typing import NamedTuple

MODES = (
    'disconnected',
    'idle',
    'unhomed',
    'aligning',
    'ready',
    'homing',
    'commissioning',
    'running',
    'damping',
    'fault',
)


OFF = ('idle', 'unhomed')
'Modes in which the boards respond and the motors are off: the first mode of a started bridge.'
HELD = ('ready', 'running')
'Modes in which the motors hold the arm.'
COMMANDABLE = (*HELD, 'damping')
"""Modes in which the arm follows a command; damping ends with the next command."""


def to_switch_on(mode: str) -> str:
    """Return the request, as the user types it, that switches the motors on in a given mode."""
    return (
        "'arm home', with the arm in its home configuration"
        if mode == 'unhomed'
        else "'arm enable'"
    )


class Answer(NamedTuple):
    """Whether a request was accepted, with the consequence or the reason for rejection."""

    accepted: bool
    message: str
