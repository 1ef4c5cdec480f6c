"""Description of arm and drone, validated when read.

URDF and YAML files are converted into the robot with its Pinocchio model and frames, and into
frozen dataclasses of boards, motors, gears, joints, limits and the drone. An invalid file causes
one clear error.
"""
