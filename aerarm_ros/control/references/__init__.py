"""What the arm shall follow at each instant.

In come checked trajectories, set points, streamed points and targets of the tool, each with its
time; out goes a `JointReference` or `TaskReference` every cycle, continuous whatever came.
"""
