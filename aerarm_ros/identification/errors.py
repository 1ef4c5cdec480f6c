"""Exceptions raised by the identification."""


class IdentificationError(ValueError):
    """Error for unusable data or options; the message states what to check."""


_CONTRADICTION = ('PrimalInfeasible', 'AlmostPrimalInfeasible')


class SolverError(IdentificationError):
    """Error for an optimization problem for which no solution exists or was found.

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
