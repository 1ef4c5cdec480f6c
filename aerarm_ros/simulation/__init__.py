"""The arm on a physics engine that shares no dynamics with the controllers' model.

In come torques of the drives and what the arm is truly made of; out go true joint positions, on a
base that stands still, moves as told or flies with rotors that are commanded too, and what an IMU
and an odometry on it would read.
"""
