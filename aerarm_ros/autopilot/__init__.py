"""Feedforward of the arm's motion through autopilots, by accelerations of set points.

From the arm's load and the drone's attitude the package computes the acceleration of a set point
in the autopilot's axes, or the stick positions for Betaflight. A model of PX4's published control
loops serves for tests.
"""
