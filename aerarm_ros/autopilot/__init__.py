"""Connections to autopilots; their set points contain an acceleration against the arm's motion.

The package computes the acceleration of a set point in the autopilot's axes, or the stick positions
for Betaflight. The inputs are the arm's load and the drone's attitude. Tests use a model of PX4's
published control loops.
"""
