"""Flight control of the drone under which the arm hangs, with feedforward of the arm's load.

The package computes the arm's feedforward and the rotors' thrusts, and detects faulty sensors. The
inputs are odometry, IMU samples, a set point, the joints' motion and the drone's description.
"""
