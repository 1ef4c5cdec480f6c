"""The states of a board as the bridge sees it."""

from enum import StrEnum


class BoardMode(StrEnum):
    """From no contact to driving motors; a fault stays until it is cleared."""

    DISCONNECTED = 'disconnected'
    IDLE = 'idle'
    ALIGNING = 'aligning'
    READY = 'ready'
    RUNNING = 'running'
    FAULT = 'fault'
