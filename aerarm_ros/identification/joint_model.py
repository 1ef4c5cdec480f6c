"""Friction, rotor and offset terms of each joint's torque, and names of regressor columns."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.model.inertia import PARAMETER_NAMES, pseudo_inertia
from aerarm_ros.motion.signals import Array


class TermKind(Enum):
    """Kind of a term of the joint torque; the value is its symbol in column names."""

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


# Unit and meaning of the coefficient of each kind of term.
_COEFFICIENTS = {
    TermKind.VISCOUS: ('Nms/rad', 'viscous friction'),
    TermKind.COULOMB: ('Nm', 'Coulomb friction'),
    TermKind.ROTOR: ('kg m^2', 'rotor inertia at the joint'),
    TermKind.OFFSET: ('Nm', 'offset'),
    TermKind.LOAD: ('-', 'friction per torque on the links'),
    TermKind.CREEP: ('Nm', 'saturating viscous friction'),
    TermKind.STRIBECK: ('Nm', 'additional friction at low speed (Stribeck)'),
    TermKind.FORWARD: ('Nm', 'Coulomb friction in positive direction only'),
    TermKind.BACKWARD: ('Nm', 'Coulomb friction in negative direction only'),
    TermKind.COUPLED_VISCOUS: ('Nms/rad', 'torque per velocity of'),
    TermKind.COUPLED_INERTIA: ('kg m^2', 'torque per acceleration of'),
}

COUPLED = (TermKind.COUPLED_VISCOUS, TermKind.COUPLED_INERTIA)
"""Kinds of terms for torque caused by another joint's motion; coefficients may be negative."""

NOT_FRICTION = (TermKind.ROTOR, *COUPLED)
"""Kinds of terms that are neither friction nor offset."""


@dataclass(frozen=True)
class JointTerm:
    """Term of one joint's torque, in addition to the torque of the links; extends thesis (2.6).

    Attributes
    ----------
    width : float
        Velocity [rad/s] over which dry friction changes sign, `s = tanh(dq / width)`; 0 is the step
        `sgn(dq)` of (2.6). For Stribeck friction, `sgn(dq) exp(-(dq / width)^2)`, it is the
        velocity at which the friction has fallen to about a third.
    driver : int or None
        Index of another joint whose motion causes the torque; None if the joint's own motion
        causes it.
    distance : float
        Angle [rad] over which Coulomb or load-dependent friction builds up after a reversal
        (presliding of an elastic gear); 0 if it reverses at once.

    Notes
    -----
    Asymmetric Coulomb friction consists of a symmetric part and a part that acts in one direction,
    `max(s, 0)` or `min(s, 0)`. Thus every coefficient is non-negative, and every term dissipates
    energy.
    """

    kind: TermKind
    width: float = 0.0
    driver: int | None = None
    distance: float = 0.0

    @property
    def symbol(self) -> str:
        """Symbol with which the column's name begins, such as 'fs'."""
        return self.kind.value

    @property
    def unit(self) -> str:
        """Unit of the term's coefficient."""
        return _COEFFICIENTS[self.kind][0]

    @property
    def meaning(self) -> str:
        """Description of the term's coefficient."""
        return _COEFFICIENTS[self.kind][1]

    @property
    def nonnegative(self) -> bool:
        """Whether the coefficient is never negative for a real joint."""
        return self.kind not in (TermKind.OFFSET, *COUPLED)

    @property
    def smooth(self) -> bool:
        """Whether the term's torque contains no higher frequencies than the motion."""
        return self.kind in (TermKind.VISCOUS, TermKind.ROTOR, TermKind.OFFSET, *COUPLED)

    def basis(self, dq: Array, ddq: Array, load: Array | None, state: Array | None = None) -> Array:
        """Return the torque of the term for a coefficient of 1.

        Parameters
        ----------
        dq, ddq : (...) ndarray
            Velocity and acceleration of the driver, or of the joint itself [rad/s], [rad/s^2].
        load : (...) ndarray or None
            Magnitude of the torque on the links [Nm]; only `LOAD` terms need it.
        state : (...) ndarray, optional
            `friction_state` of a term with `distance` along a motion; by default the state long
            after the last reversal.

        Raises
        ------
        ValueError
            If a load term is evaluated without a load.
        """
        if self.kind in (TermKind.VISCOUS, TermKind.COUPLED_VISCOUS):
            return dq
        if self.kind in (TermKind.ROTOR, TermKind.COUPLED_INERTIA):
            return ddq
        if self.kind is TermKind.OFFSET:
            return np.ones_like(dq)
        if self.kind is TermKind.STRIBECK:
            return np.asarray(np.sign(dq) * np.exp(-((dq / max(self.width, 1e-9)) ** 2)))
        sign = state
        if sign is None:
            sign = np.tanh(dq / self.width) if self.width > 0.0 else np.sign(dq)
        if self.kind is TermKind.LOAD:
            if load is None:
                raise ValueError('load-dependent friction needs the argument `load`')
            return np.asarray(load * sign)
        if self.kind is TermKind.FORWARD:
            return np.asarray(np.maximum(sign, 0.0))
        if self.kind is TermKind.BACKWARD:
            return np.asarray(np.minimum(sign, 0.0))
        return np.asarray(sign)


def friction_state(dq: Array, travel: Array, distance: float) -> Array:
    """Return the state z of friction that builds up after reversals, from -1 to 1 (Dahl, 1968).

    `dz = (sgn(dq) - z) |dq| dt / distance`. The friction `F z` of such a gear stores at most
    `F distance / 2` and dissipates the power `F |dq| z^2`. The state starts at the sign of the
    first velocity.

    Parameters
    ----------
    dq : (M, n) or (M,) ndarray
        Velocities [rad/s]. Samples without a velocity (NaN) have no state, and the following
        samples continue the state before them.
    travel : ndarray like dq
        Angle turned since the previous sample, of either direction [rad]. Unknown angles (NaN)
        count as 0.
    """
    state = np.full(dq.shape, np.nan)
    columns = (np.atleast_2d(values.T) for values in (dq, travel, state))
    for velocity, turned, column in zip(*columns, strict=True):
        known = np.isfinite(velocity)
        if known.all():
            column[:] = _joint_state(velocity, turned, distance)
        else:
            column[known] = _joint_state(velocity[known], turned[known], distance)
    return state


def _joint_state(dq: Array, travel: Array, distance: float) -> Array:
    """Return the friction state (M,) of one joint, as defined at `friction_state`."""
    if not len(dq):
        return dq
    direction = np.sign(dq)
    path = np.cumsum(np.abs(np.nan_to_num(travel, posinf=0.0, neginf=0.0)))
    first = np.concatenate([[0], np.flatnonzero(np.diff(direction)) + 1])
    # The last sample before a reversal is where it begins.
    begin = path[np.maximum(first - 1, 0)]
    decay = np.exp(-np.diff(begin, append=path[-1]) / distance).tolist()
    initial_state = [float(direction[0])]
    for sign, share in zip(direction[first].tolist(), decay, strict=True):
        initial_state.append(sign - (sign - initial_state[-1]) * share)
    length = np.diff(first, append=len(direction))
    # In place, because recordings are long.
    deficit = direction - np.repeat(initial_state[:-1], length)
    path -= np.repeat(begin, length)
    path /= -distance
    np.exp(path, out=path)
    deficit *= path
    direction -= deficit
    return np.asarray(direction)


THESIS_TERMS = (JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB))
"""Friction terms of thesis (2.6)."""

ROTOR = JointTerm(TermKind.ROTOR)
"""Rotor inertia term; the thesis omits this term, but geared joints need it."""


# Order of the blocks of columns, thesis (3.5) first.
_ORDER = tuple(TermKind)


@dataclass(frozen=True)
class JointModel:
    """Torque model of an arm: the links, and the terms of each joint.

    Attributes
    ----------
    joint_names, link_names : tuple of str
        Names of the n joints and of the links that they move.
    terms : tuple of tuples of JointTerm
        Terms of each joint.
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
        """Joint index and term of each column that follows the 10 n link columns, thesis (3.5)."""
        return tuple(
            (joint, term)
            for kind in _ORDER
            for joint, terms in enumerate(self.terms)
            for term in terms
            if term.kind is kind
        )

    def coefficients(self, theta: Array, joint: int) -> list[tuple[JointTerm, float]]:
        """Return the terms of one joint, each with its coefficient in the parameters `theta`."""
        pairs = zip(self.joint_columns, theta[10 * self.n :].tolist(), strict=True)
        return [(term, value) for (owner, term), value in pairs if owner == joint]

    @property
    def columns(self) -> tuple[str, ...]:
        """Name of every column: 'm_link1', ..., 'fv_joint1', ..., as in `Regressor.columns`.

        A coupled column ends with the driver's name: 'cv_joint1_joint2'.
        """
        links = [f'{name}_{link}' for link in self.link_names for name in PARAMETER_NAMES]
        joints = []
        for joint, term in self.joint_columns:
            moving = [joint] if term.driver is None else [joint, term.driver]
            joints.append('_'.join([term.symbol, *(self.joint_names[j] for j in moving)]))
        return (*links, *joints)

    def torque(
        self, theta: Array, links: Array, dq: Array, ddq: Array, q: Array | None = None
    ) -> Array:
        """Return the torque (M, n) of links and joints [Nm], thesis (3.5).

        Parameters
        ----------
        theta : (p,) ndarray
            Parameters in the order of `columns`.
        links : (M, n) ndarray
            Torque on the links [Nm].
        dq, ddq : (M, n) ndarray
            Joint velocities and accelerations [rad/s], [rad/s^2].
        q : (M, n) ndarray, optional
            Joint positions [rad] if the rows are one motion, in which friction builds up after
            reversals; by default the friction of steady motion.
        """
        torque, load = links.copy(), np.abs(links)
        for (joint, term), value in zip(self.joint_columns, theta[10 * self.n :], strict=True):
            moving = joint if term.driver is None else term.driver
            state = None
            if q is not None and term.distance:
                travel = np.diff(q[:, moving], prepend=q[:1, moving])
                state = friction_state(dq[:, moving], travel, term.distance)
            own = term.basis(dq[:, moving], ddq[:, moving], load[:, joint], state)
            torque[:, joint] += value * own
        return torque

    @property
    def depends_on_load(self) -> bool:
        """Whether any term depends on the torque on the links."""
        return any(term.kind is TermKind.LOAD for _, term in self.joint_columns)


@dataclass(frozen=True)
class LinkBounds:
    """User-defined bounds of total mass and centres of mass, for the semidefinite solver.

    Attributes
    ----------
    total_mass : tuple of two floats, optional
        Lower and upper bound of the total mass of all moving links (3.13) [kg], from weighing.
    centres : bool
        Whether each centre of mass must lie in a homogeneous box with the link's CAD inertia
        (3.12).
    """

    total_mass: tuple[float, float] | None = None
    centres: bool = False

    def __post_init__(self) -> None:
        """Validate the mass bounds."""
        if self.total_mass is not None:
            low, high = self.total_mass
            if not (np.isfinite([low, high]).all() and 0.0 <= low < high):
                raise IdentificationError(
                    f'total mass {low:g} .. {high:g} kg must be two non-negative numbers, the '
                    'smaller one first'
                )


def inertia_boxes(inertial: Array) -> tuple[Array, Array]:
    """Return the extent of the homogeneous box with the mass and inertia of each link.

    Parameters
    ----------
    inertial : (n, 10) ndarray
        Inertial parameters with positive masses.

    Returns
    -------
    centre : (n, 3) ndarray
        Centre of mass in the frame of the link's joint [m].
    reach : (n, 3) ndarray
        Half side lengths along the axes of that frame [m]; NaN where the inertia is not physically
        possible.
    """
    matter = pseudo_inertia(inertial)
    mass = inertial[:, :1]
    centre = inertial[:, 1:4] / mass
    spread = matter[:, :3, :3] / mass[..., None] - centre[:, :, None] * centre[:, None, :]
    variance, axes = np.linalg.eigh(spread)
    with np.errstate(invalid='ignore'):
        # Mass distributed homogeneously between -a and a has the variance a^2 / 3.
        half_edges = np.sqrt(3.0 * variance)
    return centre, np.asarray((np.abs(axes) @ half_edges[..., None])[..., 0])


CoupledJoints = Sequence[tuple[str, str]]
"""Pairs (joint, driver): motion of the joint `driver` causes a torque at the other joint."""


def coupled_terms(
    joint_names: Sequence[str], coupled: CoupledJoints
) -> tuple[tuple[JointTerm, ...], ...]:
    """Return the torque terms of coupled joints, whose drive another joint turns.

    In many wrists, a drive passes through another joint (its driver) and is turned by that joint.
    The torque of the driven joint then contains `cv dq + ca ddq`, with the motion of the driver.
    If each joint turns the drive of the other, give both pairs.

    Parameters
    ----------
    coupled : sequence of (joint, driver)

    Returns
    -------
    tuple of n tuples of JointTerm

    Raises
    ------
    IdentificationError
        If the arm lacks a joint, or a joint is its own driver.
    """
    terms: list[list[JointTerm]] = [[] for _ in joint_names]
    for joint, driver in dict.fromkeys(coupled):
        unknown = [name for name in (joint, driver) if name not in joint_names]
        if unknown:
            raise IdentificationError(
                f'coupled joints {joint}, {driver}: unknown joint {", ".join(unknown)}; the arm '
                f'has {", ".join(joint_names)}'
            )
        if joint == driver:
            raise IdentificationError(
                f"coupled joints {joint}, {driver}: name two different joints, because a joint's "
                'own friction and rotor are always in the model'
            )
        index = list(joint_names).index(driver)
        terms[list(joint_names).index(joint)] += [JointTerm(k, driver=index) for k in COUPLED]
    return tuple(map(tuple, terms))


_SMALLEST_SIZE = 0.05  # [m] assumed lower bound of the size of a link


@dataclass(frozen=True, eq=False)
class ArmParameters:
    """Nominal inertial parameters, friction and rotor inertia of an arm.

    Attributes
    ----------
    inertial : (n, 10) ndarray
        Inertial parameters in the order of thesis (3.3).
    viscous, coulomb, rotor_inertia : (n,) ndarray
        Joint-side friction and rotor inertia [Nms/rad], [Nm], [kg m^2].
    load_friction : (n,) ndarray
        Dry friction per torque transmitted by the gear [-].
    """

    inertial: Array
    viscous: Array
    coulomb: Array
    rotor_inertia: Array
    load_friction: Array

    @classmethod
    def stated(cls, robot: Robot, config: ArmConfig | None) -> 'ArmParameters':
        """Return the parameters of the URDF, and the rotor inertia from the configuration.

        Raises
        ------
        IdentificationError
            If the configuration lacks a joint of the URDF.
        """
        rotor_inertia = np.zeros(robot.n)
        if config is not None:
            missing = [name for name in robot.joint_names if name not in config.joint_names]
            if missing:
                raise IdentificationError(
                    f'joints {", ".join(missing)} of the URDF are not in the configuration, '
                    f'which has {", ".join(config.joint_names)}: pass --urdf and --config of the '
                    'same arm'
                )
            order = [config.joint_names.index(name) for name in robot.joint_names]
            rotor_inertia = config.column('reflected_inertia')[order]
        return cls(
            np.array(robot.inertial_parameters),
            np.array(robot.viscous),
            np.array(robot.coulomb),
            rotor_inertia,
            np.array(robot.load_friction),
        )

    def vector(self, model: JointModel) -> Array:
        """Return the parameters in the order of `model.columns`; 0 without a nominal value."""
        known = {
            TermKind.VISCOUS: self.viscous,
            TermKind.COULOMB: self.coulomb,
            TermKind.ROTOR: self.rotor_inertia,
            TermKind.LOAD: self.load_friction,
        }
        unknown = np.zeros(model.n)
        joints = [known.get(term.kind, unknown)[joint] for joint, term in model.joint_columns]
        return np.concatenate([self.inertial.ravel(), joints])

    def inertial_scale(self) -> Array:
        """Return a typical magnitude of each inertial parameter, from mass and gyration radius.

        Returns
        -------
        (n, 10) ndarray
            m, m l and m l^2 with the link's radius of gyration l about its joint's frame.
        """
        mass = self.inertial[:, :1]
        second_moment = np.trace(pseudo_inertia(self.inertial)[:, :3, :3], axis1=1, axis2=2)
        size = np.sqrt(np.maximum(second_moment[:, None] / mass, _SMALLEST_SIZE**2))
        return np.asarray(
            np.hstack([mass, np.repeat(mass * size, 3, 1), np.repeat(mass * size**2, 6, 1)])
        )
