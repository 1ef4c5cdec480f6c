"""User settings: tables of parameters, and parameters that several nodes share.

A table and the user's values (command line, YAML file) give up-to-date values, or a
`ParameterError` with the valid range. Shared parameters are the files of arm and drone, and
real-time settings of the operating system.
"""
