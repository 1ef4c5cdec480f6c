"""The bridge's modes by what they mean to others; all of them are `bridge_modes.MODES`."""

HELD = ('ready', 'running')
"""In which the motors hold the arm."""
COMMANDABLE = (*HELD, 'damping')
"""In which a command is followed: damping ends with the next one."""
