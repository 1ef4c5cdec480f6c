"""References of the arm at each instant.

Checked trajectories, set points, streamed points and targets of the tool, each with its time,
become one `JointReference` or `TaskReference` per cycle. The references are continuous for any
input.
"""
