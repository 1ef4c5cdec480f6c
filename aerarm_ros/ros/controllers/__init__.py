"""Parts of controllers: the loop that answers each state, and the topics of references.

A controller receives parameters, joint states, IMU samples and reference messages. One thread
passes them to the ROS-free objects of `aerarm_ros.control` and publishes their commands. Each
controller derives from `ControllerNode`.
"""
