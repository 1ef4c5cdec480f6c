"""Energy consumption of the arm's drives, by joint and cause.

The inputs are an arm's configuration, its model with friction, and measured or planned motion.
The outputs are the electrical power of the drives, their energy by joint and cause, and the power
for holding a posture.
"""
