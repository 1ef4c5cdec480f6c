"""One torque that a joint's own motion causes: friction, rotor inertia, an offset."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class TermKind(Enum):
    """What a term stands for; the value is its symbol in column names."""

    VISCOUS = 'fv'
    COULOMB = 'fs'
    ROTOR = 'Ja'
    OFFSET = 'fo'
    LOAD = 'fl'
    CREEP = 'fc'


_UNITS = {
    TermKind.VISCOUS: 'Nms/rad',
    TermKind.COULOMB: 'Nm',
    TermKind.ROTOR: 'kg m^2',
    TermKind.OFFSET: 'Nm',
    TermKind.LOAD: '-',
    TermKind.CREEP: 'Nm',
}
_MEANINGS = {
    TermKind.VISCOUS: 'viscous friction',
    TermKind.COULOMB: 'Coulomb friction',
    TermKind.ROTOR: 'rotor inertia at the joint',
    TermKind.OFFSET: 'offset',
    TermKind.LOAD: 'friction per torque on the links',
    TermKind.CREEP: 'friction that grows slowly with speed',
}


@dataclass(frozen=True)
class JointTerm:
    """A regressor column of one joint: thesis (2.6), extended.

    Attributes
    ----------
    kind : TermKind
    width : float
        Velocity [rad/s] over which dry friction changes sign, `tanh(dq / width)`; 0 is the
        step `sgn(dq)` of (2.6).
    """

    kind: TermKind
    width: float = 0.0

    @property
    def symbol(self) -> str:
        """Start of the column's name, such as 'fs'."""
        return self.kind.value

    @property
    def unit(self) -> str:
        """Unit of the coefficient."""
        return _UNITS[self.kind]

    @property
    def meaning(self) -> str:
        """What the coefficient is, in words."""
        return _MEANINGS[self.kind]

    @property
    def nonnegative(self) -> bool:
        """Whether the coefficient of a real joint cannot be negative."""
        return self.kind is not TermKind.OFFSET

    @property
    def smooth(self) -> bool:
        """Whether the torque has no more high frequencies than the motion itself."""
        return self.kind in (TermKind.VISCOUS, TermKind.ROTOR, TermKind.OFFSET)

    def basis(self, dq: Array, ddq: Array, load: Array | None) -> Array:
        """Return the torque per coefficient.

        Parameters
        ----------
        dq, ddq : (...) ndarray
            [rad/s], [rad/s^2]
        load : (...) ndarray or None
            Magnitude of the torque on the links [Nm]; only `LOAD` terms need it.

        Raises
        ------
        ValueError
            If a load is needed and not given.
        """
        if self.kind is TermKind.VISCOUS:
            return dq
        if self.kind is TermKind.ROTOR:
            return ddq
        if self.kind is TermKind.OFFSET:
            return np.ones_like(dq)
        sign = np.tanh(dq / self.width) if self.width > 0.0 else np.sign(dq)
        if self.kind is TermKind.LOAD:
            if load is None:
                raise ValueError('friction that depends on the load needs the load')
            return np.asarray(load * sign)
        return np.asarray(sign)


THESIS_TERMS = (JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB))
"""The friction of thesis (2.6)."""

ROTOR = JointTerm(TermKind.ROTOR)
"""Rotor inertia, which the thesis leaves out and geared joints need."""
