"""Feedforward of the arm's motion to an autopilot, as acceleration in the set points.

The package computes the acceleration of a set point in the autopilot's axes, or the stick positions
for Betaflight. The inputs are the arm's load and the drone's attitude. Tests use a model of PX4's
published control loops.
"""
