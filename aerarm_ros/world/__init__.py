"""The tool held in the world by an arm under a drone that sways, and what the drone can bear.

In come odometry, IMU samples, joint states and targets in the world; out goes a `WorldReference`
for the law that holds the tool there, and how far the arm still reaches. `RotorGovernor` slows
motions of the joints that the rotors could not bear.
"""
