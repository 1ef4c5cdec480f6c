"""ROS-free part of the bridge: converts joint commands to SPI frames, and frames to joint states.

`BridgeCycle` runs one cycle of 1 ms. The gate limits the joint command, `boards` converts it to
motor references, `frames` encodes these, and a transport exchanges the frames with the motor
boards. Attributes of the cycle contain the joint states, the mode of the arm and its faults.
"""
