"""Readers of message files (MCAP, SQLite, ROS 1) with limits of memory and time.

The files may come from any source, and may be truncated or damaged. A reader returns blocks of
messages, each message once, with one warning per missing part, and the file's own message counts.
Memory and time stay within the limits.
"""
