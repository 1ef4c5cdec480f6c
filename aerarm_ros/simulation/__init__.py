"""Simulation of arm and drone with a physics engine instead of the controllers' own model.

From drive torques and true parameters, the simulation computes true joint positions. The base is
fixed, follows a given motion, or flies with commanded rotors. Emulated sensors give the readings
of an IMU and an odometry on the base.
"""
