"""What the bridge may be doing, and what it answers to requests.

- disconnected: a board does not answer.
- idle: the boards answer and are off.
- unhomed: likewise, and the zero of a joint is unknown. Only `home` and
  commissioning move the arm.
- aligning: the boards turn their motors to find the rotors' directions. The arm moves.
- ready: the arm is held where it is; no command has come yet.
- homing: the motors search the encoders' index pulses.
- commissioning: one motor turns its joint at low torque and speed, all others are off.
- running: the last command is followed.
- damping: the last command is too old, and nobody asked to `hold` the arm after it. The
  joints are damped, so the arm sinks slowly; the next good command is followed again, and
  `enable` or `hold` hold the arm where it is.
- fault: stopped for the reason that `faults` gives. The joints are damped where their
  board and encoder still work, until `clear_fault`.
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
'Modes in which the arm tracks a command: damping ends with the next one.'


def to_switch_on(mode: str) -> str:
    """Return the request, as typed, that switches on the motors of an arm in a mode."""
    return (
        "'arm home', with the arm in its home configuration"
        if mode == 'unhomed'
        else "'arm enable'"
    )


class Answer(NamedTuple):
    """Whether a request was accepted, and what happens now or why not."""

    accepted: bool
    message: str
