"""Planner of rest-to-rest motions with low cost within all limits.

The inputs are an arm's model with friction and payload, its limits, and a goal (joint positions or
a tool position). The output is a motion with its energy, and its margins to all limits at every
control cycle.
"""
