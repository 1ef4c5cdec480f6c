"""Nominal (CAD) parameters of an arm, from the arm's URDF and configuration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import COUPLED, JointModel, JointTerm, TermKind
from aerarm_ros.model.inertia import pseudo_inertia
from aerarm_ros.motion.signals import Array


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
