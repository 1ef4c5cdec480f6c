"""The arm as data, checked when it is read.

In come a URDF and YAML files; out go the robot, with its Pinocchio model and frames, and frozen
dataclasses of boards, motors, gears, joints and limits, and of the drone that carries it all. A
wrong file is one clear error.
"""
