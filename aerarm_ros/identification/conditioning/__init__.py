"""Conditioning of recordings: uniform grid, whole periods, filters, derivatives (thesis 3.5).

The input is a recording and the user's description of its motion. The output is samples of
position, velocity, acceleration and torque, with warnings where the motion differs from its
description.
"""
