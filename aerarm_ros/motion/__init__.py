"""Basic types of motion, which control laws, excitations and the bridge share.

The package contains references, states and commands in the thesis's symbols (q, dq, ddq, tau), and
polynomials that connect postures and velocities. The package does not depend on arms, limits or
ROS messages.
"""
