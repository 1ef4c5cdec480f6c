"""ROS 2 suite for a light four-joint arm that hangs under a drone."""
