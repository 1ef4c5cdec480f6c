"""ROS node of the bridge, with its topics, services and parameters.

The class `HardwareBridge` connects these parts with `BridgeCycle` in `aerarm_ros.hardware`, which
controls the motors.
"""
