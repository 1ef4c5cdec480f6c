"""Parts of `flight_control`, which flies a drone, and of nodes that support autopilots.

The modules convert parameters and messages (set points, trajectories, the arm's load) to the
ROS-free objects of `aerarm_ros.flight`, and reject invalid messages.
"""
