"""Identification of single drives: friction, rotor, torque constant, resistance (thesis 4.4).

The input is a set of runs in which a single joint moves. The results are the drive's parameters
with their uncertainty, as YAML, as a configuration file and as a report.
"""
