"""The motor boards as the bridge drives them, and what it makes of their answers.

In come limited commands and the boards' frames; out go motor references in frames, the joints'
positions, velocities and torques, the motors' power, and the faults of boards and encoders.
"""
