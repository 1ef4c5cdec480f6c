"""Runs of the larger programs after their command line is parsed.

`identifier`, `payload_estimator --bag`, `excitation_designer`, `demo` and `arm init` each have a
class, which takes the options and writes files and text for a terminal.
"""
