"""From recordings to samples: a uniform grid, whole periods, filters, derivatives (thesis 3.5).

In come recordings and what the user says of their motion; out go samples of position, velocity,
acceleration and torque, and warnings where the motion is not what was said.
"""
