"""An executable as a process: its command line, its start, signals, its end, and its children.

In come arguments and what makes a node; out goes an exit status, with one line on standard error
for whatever a user can mend. `NodeProcess` starts another executable and ends it. Some modules
serve programs that have no node, and import no ROS.
"""
