"""Files that hold messages, MCAP, SQLite or of ROS 1, read within limits whatever they hold.

In comes a file that anybody may have written, cut or damaged; out go blocks of messages, one
warning for each thing that is missing, and the file's own account of what it holds. Reading
takes no more memory and time than the limits allow, and no message twice.
"""
