"""Feedforward of the arm's motion through autopilots, by accelerations of set points.

The package computes the acceleration of a set point in the autopilot's axes, or the stick
positions for Betaflight. The inputs are the arm's load and the drone's attitude. A model of PX4's
published control loops serves for tests.
"""
