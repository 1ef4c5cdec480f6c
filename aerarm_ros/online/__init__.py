"""Estimation of the arm's payload, friction and contacts while the arm moves.

The estimators process states of the arm, the motion of its base and the model of the arm without a
payload. The estimators return, at 50 Hz, the inertial parameters of the payload with standard
deviations, and the present friction.
"""
