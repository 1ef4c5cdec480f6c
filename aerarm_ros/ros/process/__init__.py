"""Command line, start, signals, end and child processes of an executable.

An executable returns an exit status, and prints one line on standard error for each problem that a
user can solve. `NodeProcess` starts and ends another executable. Some modules serve programs
without a node and do not import ROS.
"""
