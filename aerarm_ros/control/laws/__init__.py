"""Control laws, one per file, and the inverse kinematics of the laws for the tool.

A law receives the measured `ArmState`, a reference, the cycle's length and the motion of the base.
A law returns a `JointCommand`. The only memory of a law are its integrals.
"""
