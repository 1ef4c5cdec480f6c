"""Conditioning of recordings, thesis 3.5: uniform sampling, whole periods, filters, derivatives.

The input is a recording and the user's description of its motion. The output is uniform samples
of position, velocity, acceleration and torque, and warnings if the motion differs from its
description.
"""
