"""Encrypted UDP connection between the drone and a ground computer; imports no ROS."""
