"""Energy balance of the arm.

From an arm's configuration, its model with friction, and measured or planned motion, the package
computes the drives' power, the energy by joint and cause, and the power for holding a posture.
"""
