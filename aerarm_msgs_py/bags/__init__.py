"""Writer and readers of bags (rosbag2 directories).

The writer stores serialized messages and topic descriptions in an MCAP file that stays readable
after a crash. The readers accept MCAP, SQLite and ROS 1 bags. They return blocks of messages,
arrays of joint states, or series of poses. Reading does not need ROS.
"""
