"""Regression of the torque model: named columns, triangular factors, prior and noise.

Samples and joint terms are reduced to a small triangular system, which all solvers use. The package
also provides its closed-form solution and the base parameters that a motion identifies.
"""
