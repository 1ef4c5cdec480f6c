"""Comparison of controllers on the simulated arm, thesis 5.4, without ROS.

The inputs are an arm, a motion, and the true parameters of the simulated arm. The outputs are one
reproducible run per case, and a page with the tracking errors of all runs.
"""
