"""Dynamic model of the arm: kinematics, equations of motion, and regressor of its parameters.

From joint positions, velocities and accelerations the package computes frames, torques, inertia,
gravity and the thesis's regressor, also for arm and vehicle combined. Pinocchio performs the
rigid-body computations; this package adds rotors and friction.
"""
