"""Files of messages (MCAP, SQLite, ROS 1), read within limits of memory and time.

A file may come from any source, and may be truncated or damaged. The result is blocks of messages,
one warning per missing part, and the file's own message counts. Reading stays within the limits,
and returns no message twice.
"""
