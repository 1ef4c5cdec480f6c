"""Regression of torque: regressor columns with names, triangular factors, prior and noise.

The regression reduces samples and joint terms to a small triangular system, which all solvers
use. The package also computes the closed-form solution of this system, and the base parameters
that a motion identifies.
"""
