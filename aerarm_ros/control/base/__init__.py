"""The base of the arm in motion: what the drone does to the arm, and the arm to the drone.

In come IMU samples in the autopilot's or ROS's frames, and commands of the rotors; out goes a
`BaseMotion` at any time near now, the arm's dynamics on such a base, and
the wrench of the arm on what carries it.
"""
