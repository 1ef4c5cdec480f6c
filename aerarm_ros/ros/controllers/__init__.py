"""Base classes, parameters and topics that several controllers and estimators share.

A controller receives parameters, joint states, IMU samples and reference messages. One thread
passes them to the ROS-free objects of `aerarm_ros.control`, and publishes the commands that these
objects compute. Each controller derives from `ControllerNode`.
"""
