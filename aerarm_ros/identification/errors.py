"""Errors of identification."""


class IdentificationError(ValueError):
    """Data or an option that can't be used; the message says what to check."""


_CONTRADICTION = ('PrimalInfeasible', 'AlmostPrimalInfeasible')


class SolverError(IdentificationError):
    """A program without a solution: because there is none, or because none was found.

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
