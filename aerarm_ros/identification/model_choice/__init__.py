"""Automatic choice of the filter, the direction of gravity, and the friction terms of each joint.

The chosen filter gives the smallest torque error, and the chosen friction terms predict held-out
parts of the motion best. All tried alternatives are reported.
"""
