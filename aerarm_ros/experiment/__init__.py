"""Comparison of controllers on the simulated arm, thesis 5.4, without ROS.

From an arm, a motion and the parameters of the plant the package produces one reproducible run per
case, and a page with all errors.
"""
