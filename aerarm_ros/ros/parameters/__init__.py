"""What a user can set: tables of parameters, and what several nodes make of theirs.

In comes a table, and what a command line or a YAML file gives; out go values that are kept up to
date, or a `ParameterError` that says what would be right. Files of arm and
drone and wishes to the
operating system are parameters of several nodes, so they are here.
"""
