"""Which terms each joint of an arm has, and the names of the regressor's columns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.joint_term import JointTerm, TermKind
from aerarm_ros.model.inertia import PARAMETER_NAMES

Array = npt.NDArray[np.float64]

# Order of the blocks of columns, thesis (3.5) first.
_ORDER = tuple(TermKind)


@dataclass(frozen=True)
class JointModel:
    """The joints' part of the torque model.

    Attributes
    ----------
    joint_names, link_names : tuple of str
        The n joints and the links they move.
    terms : tuple of tuples of JointTerm
        For each joint.
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    terms: tuple[tuple[JointTerm, ...], ...]

    @classmethod
    def uniform(
        cls, joint_names: Sequence[str], link_names: Sequence[str], terms: Sequence[JointTerm]
    ) -> 'JointModel':
        """Return a model in which every joint has the same terms."""
        return cls(tuple(joint_names), tuple(link_names), (tuple(terms),) * len(joint_names))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def joint_columns(self) -> tuple[tuple[int, JointTerm], ...]:
        """Joint index and term of each column behind the links' 10 n, in the order of (3.5)."""
        return tuple(
            (joint, term)
            for kind in _ORDER
            for joint, terms in enumerate(self.terms)
            for term in terms
            if term.kind is kind
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Name of every column: 'm_link1', ..., 'fv_joint1', ..., as in `Regressor.columns`.

        A coupled one's ends with its driver: 'cv_joint1_joint2'.
        """
        links = [f'{name}_{link}' for link in self.link_names for name in PARAMETER_NAMES]
        joints = []
        for joint, term in self.joint_columns:
            moving = [joint] if term.driver is None else [joint, term.driver]
            joints.append('_'.join([term.symbol, *(self.joint_names[j] for j in moving)]))
        return (*links, *joints)

    def torque(self, theta: Array, links: Array, dq: Array, ddq: Array) -> Array:
        """Return the torque (M, n) of links and joints [Nm], thesis (3.5).

        Parameters
        ----------
        theta : (p,) ndarray
            In the order of `columns`.
        links : (M, n) ndarray
            Torque on the links [Nm].
        dq, ddq : (M, n) ndarray
            [rad/s], [rad/s^2]
        """
        torque, load = links.copy(), np.abs(links)
        for (joint, term), value in zip(self.joint_columns, theta[10 * self.n :], strict=True):
            moving = joint if term.driver is None else term.driver
            torque[:, joint] += value * term.basis(dq[:, moving], ddq[:, moving], load[:, joint])
        return torque

    @property
    def depends_on_load(self) -> bool:
        """Whether a term depends on the torque on the links."""
        return any(term.kind is TermKind.LOAD for _, term in self.joint_columns)
