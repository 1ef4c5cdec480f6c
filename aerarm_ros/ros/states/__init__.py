"""Subscriptions to joint states, IMU, odometry and rotor commands, read as serialized messages.

A loop receives every joint state, a display only the newest one. Values are in the arm's joint
order. The package also contains the diagnostics of nodes that publish a command for each joint
state.
"""
