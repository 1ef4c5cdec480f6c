"""Subscriptions to the arm's states: every state for a loop, or the newest for a display.

Serialized messages of joint_states, imu and rotor_command become positions, velocities and torques
in the arm's joint order. The package also provides diagnostics of the stream, message headers and
the modes in which the bridge holds the arm.
"""
