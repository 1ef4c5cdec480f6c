"""The bridge's modes by what they mean to others; all of them are `bridge_modes.MODES`."""

OFF = ('idle', 'unhomed')
"""In which the boards answer and the motors are off: what a bridge that has started is in."""
HELD = ('ready', 'running')
"""In which the motors hold the arm."""
COMMANDABLE = (*HELD, 'damping')
"""In which a command is followed: damping ends with the next one."""


def to_switch_on(mode: str) -> str:
    """Return the request, as typed, that switches on the motors of an arm in a mode."""
    return "'arm home', the arm in its home configuration" if mode == 'unhomed' else "'arm enable'"
