"""One drive at a time: friction, rotor inertia, torque constant, resistance (thesis 4.4).

In come runs in which a single joint moves; out go the drive's parameters with their uncertainty,
as YAML, as a configuration that has them, and as a report.
"""
