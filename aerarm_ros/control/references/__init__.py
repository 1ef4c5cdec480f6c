"""References of joints and tool for the control laws: trajectories, targets and streams.

Checked trajectories, set points, streamed points and targets of the tool, each with its time,
become one `JointReference` or `TaskReference` per cycle. The references are continuous for any
input.
"""
