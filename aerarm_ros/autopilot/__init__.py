"""Arm feed-forward through autopilots: set points with accelerations, in the autopilot's frames.

In come what the arm does to its drone, and the drone's attitude; out goes the acceleration of a set
point, or the sticks of a Betaflight. PX4's loops, as they are public, are there to try it on.
"""
