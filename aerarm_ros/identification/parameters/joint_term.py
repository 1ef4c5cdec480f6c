"""One torque of a joint beside its links': friction, rotor inertia, an offset, a coupling."""

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
    STRIBECK = 'fb'
    FORWARD = 'fp'
    BACKWARD = 'fn'
    COUPLED_VISCOUS = 'cv'
    COUPLED_INERTIA = 'ca'


_UNITS = {
    TermKind.VISCOUS: 'Nms/rad',
    TermKind.COULOMB: 'Nm',
    TermKind.ROTOR: 'kg m^2',
    TermKind.OFFSET: 'Nm',
    TermKind.LOAD: '-',
    TermKind.CREEP: 'Nm',
    TermKind.STRIBECK: 'Nm',
    TermKind.FORWARD: 'Nm',
    TermKind.BACKWARD: 'Nm',
    TermKind.COUPLED_VISCOUS: 'Nms/rad',
    TermKind.COUPLED_INERTIA: 'kg m^2',
}
_MEANINGS = {
    TermKind.VISCOUS: 'viscous friction',
    TermKind.COULOMB: 'Coulomb friction',
    TermKind.ROTOR: 'rotor inertia at the joint',
    TermKind.OFFSET: 'offset',
    TermKind.LOAD: 'friction per torque on the links',
    TermKind.CREEP: 'friction that grows slowly with speed',
    TermKind.STRIBECK: 'friction at low speed only (Stribeck)',
    TermKind.FORWARD: 'Coulomb friction in positive direction only',
    TermKind.BACKWARD: 'Coulomb friction in negative direction only',
    TermKind.COUPLED_VISCOUS: 'torque per velocity of',
    TermKind.COUPLED_INERTIA: 'torque per acceleration of',
}

COUPLED = (TermKind.COUPLED_VISCOUS, TermKind.COUPLED_INERTIA)
"""Torque by another joint's motion: of either sign."""


@dataclass(frozen=True)
class JointTerm:
    """A regressor column of one joint: thesis (2.6), extended.

    Attributes
    ----------
    kind : TermKind
    width : float
        Velocity [rad/s] over which dry friction changes sign, `s = tanh(dq / width)`; 0 is the
        step `sgn(dq)` of (2.6). Of Stribeck friction, `sgn(dq) exp(-(dq / width)^2)`, the
        velocity by which it has fallen to a third.
    driver : int or None
        Index of the joint whose motion causes the torque, where that is another one.

    Notes
    -----
    Asymmetric Coulomb friction is that of both directions plus a part that acts in one of them,
    `max(s, 0)` or `min(s, 0)`. So every coefficient is not negative, and every term dissipates.
    """

    kind: TermKind
    width: float = 0.0
    driver: int | None = None

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
        return self.kind not in (TermKind.OFFSET, *COUPLED)

    @property
    def smooth(self) -> bool:
        """Whether the torque has no more high frequencies than the motion itself."""
        return self.kind in (TermKind.VISCOUS, TermKind.ROTOR, TermKind.OFFSET, *COUPLED)

    def basis(self, dq: Array, ddq: Array, load: Array | None) -> Array:
        """Return the torque per coefficient.

        Parameters
        ----------
        dq, ddq : (...) ndarray
            Of the driver, the joint itself where there is none [rad/s], [rad/s^2].
        load : (...) ndarray or None
            Magnitude of the torque on the links [Nm]; only `LOAD` terms need it.

        Raises
        ------
        ValueError
            If a load is needed and not given.
        """
        if self.kind in (TermKind.VISCOUS, TermKind.COUPLED_VISCOUS):
            return dq
        if self.kind in (TermKind.ROTOR, TermKind.COUPLED_INERTIA):
            return ddq
        if self.kind is TermKind.OFFSET:
            return np.ones_like(dq)
        if self.kind is TermKind.STRIBECK:
            return np.asarray(np.sign(dq) * np.exp(-((dq / max(self.width, 1e-9)) ** 2)))
        sign = np.tanh(dq / self.width) if self.width > 0.0 else np.sign(dq)
        if self.kind is TermKind.LOAD:
            if load is None:
                raise ValueError('friction that depends on the load needs the load')
            return np.asarray(load * sign)
        if self.kind is TermKind.FORWARD:
            return np.asarray(np.maximum(sign, 0.0))
        if self.kind is TermKind.BACKWARD:
            return np.asarray(np.minimum(sign, 0.0))
        return np.asarray(sign)


THESIS_TERMS = (JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB))
"""The friction of thesis (2.6)."""

ROTOR = JointTerm(TermKind.ROTOR)
"""Rotor inertia, which the thesis leaves out and geared joints need."""
