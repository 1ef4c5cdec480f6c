"""Solvers that compute parameter estimates from a regression with prior and limits.

The input is a fitted regression with CAD parameters and bounds of the parameters. Each solver
returns an estimate with notes for the user. `solvers.py` lists and runs all solvers; each
`*_solver.py` implements one.
"""
