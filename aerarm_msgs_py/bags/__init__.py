"""Bags: rosbag2 folders of MCAP files, with crash-safe writing and reading of any storage format.

The writer stores serialized messages of given topics. The reader returns blocks of messages, joint
states as arrays, and further data of a recorded motion. Reading needs no ROS installation.
"""
