"""ROS parameters of the nodes: their description, declaration and check.

A table of parameters is declared on a node, which applies the user's values (command line, YAML
file). An invalid value causes a `ParameterError` that states the valid range. Several nodes share
the parameters for the files of arm and drone, and the real-time settings.
"""
