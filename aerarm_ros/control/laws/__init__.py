"""One control law a file, and the inverse kinematics of those that need it.

In come the measured `ArmState`, a reference, the cycle's length and the motion of the base; out
goes a `JointCommand`. A law keeps what it integrates and nothing else.
"""
