"""Flight control of the drone that carries the arm, with the arm's load.

From odometry, IMU samples, a set point, the joints' motion and the drone's description, the
package computes the arm's feedforward, the rotors' thrusts, and problems of the sensors.
"""
