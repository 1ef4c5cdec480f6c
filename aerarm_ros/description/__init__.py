"""Description of arm and drone, read from files and validated.

URDF and YAML files are converted into the robot with its Pinocchio model and frames, and into
frozen dataclasses of boards, motors, gears, joints, limits and the drone. An invalid file causes
one error that names the file and the key.
"""
