"""Where the arm's energy goes.

In come an arm's configuration, its model with friction, and measured or planned motion; out go the
power of the drives, joules by joint and cause, and what it costs to hold a posture.
"""
