"""Flying the drone that carries the arm: what the arm adds to it, and a controller.

In come odometry, IMU samples, a set point, the joints' motion and the drone's description; out go
what may be fed forward of the arm, the thrusts of the rotors, and what is wrong with the sensors.
"""
