"""Controllers compared on the simulated arm, thesis 5.4: the whole stack but ROS.

In come an arm, a motion and the parameters of the plant; out goes one run a case, the same every
time, and a page with the errors of all.
"""
