"""Calibration of an arm's geometry, of its mount and of the drone's IMU.

Pure: observations and a URDF in; estimates, files and pages out.
"""
