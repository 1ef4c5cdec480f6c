"""Exchange of motor references and measurements with the motor boards.

Inputs are limited commands and received frames. Outputs are frames with motor references, joint
positions, velocities and torques, motor powers, and faults of boards and encoders.
"""
