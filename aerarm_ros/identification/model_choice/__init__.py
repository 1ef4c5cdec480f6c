"""Automatic choice of filter, direction of gravity, and friction terms of each joint.

The chosen filter has the smallest torque error, and the chosen terms predict held-out motion best.
All tried alternatives are reported.
"""
