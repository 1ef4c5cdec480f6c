"""Control of the tool in the world frame by an arm under a swaying drone.

From odometry, IMU samples, joint states and targets in the world, the package computes a
`WorldReference` for the control law, and the remaining reach of the arm. `RotorGovernor` slows
joint motions that exceed the rotors' capacity.
"""
