"""How a motion of a trajectory follower can end."""

from enum import Enum


class MotionEnd(Enum):
    """What ended it."""

    REACHED = 'it has reached its goal'
    OFF_PATH = 'the arm was too far from its path'
    OFF_GOAL = 'the arm was too far from its goal when its time was over'
    REPLACED = 'another motion has taken its place'
    STOPPED = 'it was stopped, or control began anew'
