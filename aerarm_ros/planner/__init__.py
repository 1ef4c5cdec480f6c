"""Planner of rest-to-rest motions with low cost within all limits.

The inputs are an arm's model with friction and payload, its limits, and a goal (joint positions or
a tool position). The planner returns a motion, its energy, and its margins in a dense check.
"""
