"""The arm's states as they come: every one for a loop, or the newest for people.

In come serialized messages of joint_states, imu and rotor_command; out go positions, velocities
and torques in the arm's order of joints, what there is to say of the stream on /diagnostics, and
what others make of states: headers, and which modes hold the arm.
"""
