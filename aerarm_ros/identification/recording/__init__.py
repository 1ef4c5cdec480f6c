"""Recordings of arm motion, with selection and checks of usable data.

The input is the joint states of a bag. A recording contains checked values with joints in the arm's
order, restricted to the time in which the arm follows commands. Messages with a repeated stamp are
removed, and single spikes are interpolated. An unusable recording raises `IdentificationError`.
"""
