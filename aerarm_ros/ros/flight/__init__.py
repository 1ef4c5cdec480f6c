"""Parts of the node that flies a drone.

The modules convert parameters and messages (set points, trajectories, the arm's load) to the
ROS-free objects of `aerarm_ros.flight`, and reject invalid messages.
"""
