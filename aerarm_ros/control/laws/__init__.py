"""Control laws, one per file, and the inverse kinematics that some of them need.

A law receives the measured `ArmState`, a reference, the cycle's length and the motion of the base.
A law returns a `JointCommand`. The only memory of a law are its integrals.
"""
