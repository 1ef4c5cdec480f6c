"""Exceptions raised by the identification."""


class IdentificationError(ValueError):
    """Unusable data or option; the message states what to check."""


_CONTRADICTION = ('PrimalInfeasible', 'AlmostPrimalInfeasible')


class SolverError(IdentificationError):
    """Optimization problem that has no solution, or for which the solver found none.

    Parameters
    ----------
    status : str
        Status reported by the solver.

    Attributes
    ----------
    contradiction : bool
        Whether the constraints are known to be contradictory.
    """

    def __init__(self, status: str) -> None:
        super().__init__(
            f'the semidefinite program ended with {status}: check that masses and inertias of the '
            'URDF are plausible'
        )
        self.status = status
        self.contradiction = status in _CONTRADICTION
