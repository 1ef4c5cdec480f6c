"""Bags: rosbag2 directories of MCAP files, written crash-safe, and read in any storage format.

The package writes serialized messages and topic descriptions to a bag. The package reads a bag as
blocks of messages, as arrays of joint states, and as other topics of a motion. Reading does not
need ROS.
"""
