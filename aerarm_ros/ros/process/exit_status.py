"""Exit statuses with a meaning of their own."""

USER_ERROR = 2  # what was asked for cannot be done as asked
INTERRUPTED = 130  # ended by Ctrl-C, as shells say it
