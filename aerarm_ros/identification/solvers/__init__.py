"""From a regression with prior and limits to estimates that a real arm could have.

In come a fitted regression, CAD's parameters and bounds; out goes an estimate a solver, with what
the user should know of it. `solvers.py` lists and runs all; a `*_solver.py` is one of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'annealing_solver': ['solve_annealing'],
        'cone_program': ['ConeProgram'],
        'entropic_solver': ['solve_entropic'],
        'estimate': ['Estimate'],
        'huber_solver': ['solve_huber'],
        'least_squares_solver': ['solve_least_squares'],
        'physical_limits': ['PhysicalLimits'],
        'physical_program': ['PhysicalProgram'],
        'relaxation': ['solve_relaxed'],
        'semidefinite_solver': ['solve_semidefinite'],
        'slsqp_solver': ['solve_slsqp'],
        'solver_error': ['SolverError'],
        'solvers': ['ALWAYS', 'FAST', 'RECOMMENDED', 'SOLVERS', 'solve_all'],
        'thesis_problem': ['ThesisProblem'],
    },
)
