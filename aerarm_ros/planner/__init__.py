"""Planner of rest-to-rest motions with low cost within all limits.

From an arm's model with friction and payload, its limits, and a goal (joint positions or a tool
position), the planner computes a motion, its energy, and its margins in a dense check.
"""
