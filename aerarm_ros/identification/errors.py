"""Errors of identification."""


class IdentificationError(ValueError):
    """Unusable data or option; the message states what to check."""


_CONTRADICTION = ('PrimalInfeasible', 'AlmostPrimalInfeasible')


class SolverError(IdentificationError):
    """Optimisation problem without a solution, or whose solution was not found.

    Parameters
    ----------
    status : str
        What the solver says of it.

    Attributes
    ----------
    status : str
    contradiction : bool
        Whether the constraints are known to exclude each other.
    """

    def __init__(self, status: str) -> None:
        super().__init__(
            f'the semidefinite program ended with {status}: check that masses and inertias of the '
            'URDF are plausible'
        )
        self.status = status
        self.contradiction = status in _CONTRADICTION
