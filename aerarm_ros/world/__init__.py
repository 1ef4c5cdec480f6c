"""Control of the tool's position in the world frame, by an arm under a swaying drone.

The package computes a `WorldReference` for the control law, and the remaining reach of the arm.
The inputs are odometry, IMU samples, joint states and targets in the world. `RotorGovernor` slows
joint motions that exceed the rotors' capacity.
"""
