"""Motion of the arm's base: the effect of the drone on the arm, and of the arm on the drone.

The estimators take IMU samples, in the axes of the autopilot or of ROS, and rotor commands. The
estimators return a `BaseMotion` at any time near now. The package also contains the arm's dynamics
on such a base, and the wrench of the arm on its vehicle.
"""
