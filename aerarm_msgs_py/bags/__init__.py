"""Bags: rosbag2 folders of MCAP files, written so that they survive, read whatever their storage.

In come serialized messages and what is said of their topics; out goes a bag. And back: blocks of
messages, joint states as arrays, what else a motion left behind. Reading needs no ROS.
"""
