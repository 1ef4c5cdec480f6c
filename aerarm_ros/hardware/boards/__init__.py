"""Motor boards: encoding of references into frames and evaluation of the boards' answers.

Inputs are limited commands and received frames. Outputs are frames with motor references, joint
positions, velocities and torques, motor powers, and faults of boards and encoders.
"""
