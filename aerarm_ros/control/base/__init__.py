"""Motion of the arm's base, its effect on the arm, and the arm's reaction on the drone.

The estimators take IMU samples, in the axes of the autopilot or of ROS, and rotor commands. The
estimators return a `BaseMotion` at any time near now. The package also contains the arm's dynamics
on such a base, and the wrench of the arm on its vehicle.
"""
