"""Command line, start and end of an executable, signals, and child processes.

An executable returns an exit status, and prints one line on standard error for each problem that a
user can solve. `NodeProcess` starts and ends another executable. Some modules serve programs
without a node and do not import ROS.
"""
