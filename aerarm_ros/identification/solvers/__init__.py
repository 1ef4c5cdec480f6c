"""From a regression with prior and limits to estimates that a real arm could have.

In come a fitted regression, CAD's parameters and bounds; out goes an estimate a solver, with what
the user should know of it. `solvers.py` lists and runs all; a `*_solver.py` is one of them.
"""
