"""Arm modes that the bridge publishes, and the type of the bridge's answers to requests.

- disconnected: a board does not answer.
- idle: the boards answer and the motors are off.
- unhomed: the motors are off, and the encoder zero of a joint is unknown. Only `home` and
  commissioning move the arm.
- aligning: the boards turn their motors to find the rotor angles. The arm moves.
- ready: the arm holds its position until a command arrives.
- homing: the motors search for the encoders' index pulses.
- commissioning: one motor turns its joint at low torque and speed; all other motors are off.
- running: the arm follows the last command.
- damping: the last command is too old, and no `hold` request is active. The joints are damped, so
  the arm sinks slowly. The arm follows the next valid command; `enable` or `hold` make it hold its
  position.
- fault: the arm is stopped for the reason given by `faults`. Joints with a working board and
  encoder are damped until `clear_fault`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # Clients of the bridge load no bridge.
    from aerarm_ros.hardware.bridge_cycle import BridgeCycle

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
'Modes in which the boards answer and the motors are off; the bridge starts in one of them.'
HELD = ('ready', 'running')
"""Modes in which the motors carry the arm's weight, by position control or a command."""
COMMANDABLE = (*HELD, 'damping')
"""Modes in which the arm accepts a joint command; a command ends the mode damping."""


def to_switch_on(mode: str) -> str:
    """Return the command by which the user switches the motors on in this arm mode."""
    commands = {
        'unhomed': "'arm home', with the arm in its home configuration",
        'fault': "'arm clear_fault'",
    }
    return commands.get(mode, "'arm enable'")


class Answer(NamedTuple):
    """Answer to a request: its acceptance, and the result or the reason for the rejection."""

    accepted: bool
    message: str


Action = Callable[['BridgeCycle'], Answer]
"""Function that executes a user's request in the bridge, between two cycles."""
ACTIONS: dict[str, Action] = {
    'enable': lambda cycle: cycle.enable(),
    'hold': lambda cycle: cycle.hold(),
    'disable': lambda cycle: cycle.disable(),
    'clear_fault': lambda cycle: cycle.clear_fault(),
    'home': lambda cycle: cycle.home(),
    'e_stop': lambda cycle: cycle.e_stop('service e_stop'),
}
# Actions that run even after their client's time-out.
STOPS = {'disable', 'e_stop'}
# If the client's namespace has no arm, this action goes to every arm: damping one arm too many is
# safe, missing one is not.
REACHES_ALL = {'e_stop'}
NOT_ACTIVE = 'the bridge is not active: activate it first (autostart:=true or ros2 lifecycle set)'
"""Message in the answer of a service while the bridge runs no cycles."""
BRIDGES = ('hardware_bridge', 'fake_hardware')
"""Names of the two bridge nodes."""
