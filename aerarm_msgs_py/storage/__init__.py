"""Readers of bag files (MCAP, SQLite, ROS 1) with limits of memory and time.

A file may be malicious, truncated or damaged. The readers return blocks of messages, one warning
per missing part, and the number of messages that the file states. They stay within the limits and
return no message twice.
"""
