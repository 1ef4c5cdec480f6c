"""The bridge without ROS: from joint commands to frames, and from frames to joint states.

In comes a joint command and the time; out go the joints' state, the mode of the arm, and what is
wrong. `BridgeCycle` is the door: one cycle of 1 ms through the rooms inside, in the order of the
flow: the gate limits a command, the boards make frames of it, a transport carries them.
"""
