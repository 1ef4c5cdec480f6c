"""Calibration of an arm's geometry, its mount and the drone's IMU.

The package has no side effects: it converts observations and a URDF into estimates, file texts and
pages.
"""
