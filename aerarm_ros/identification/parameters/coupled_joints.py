"""Joints whose torque depends on the motion of another one, as drives through a wrist have it."""

from collections.abc import Sequence

from aerarm_ros.identification.parameters.joint_term import COUPLED, JointTerm
from aerarm_ros.identification.recording.identification_error import IdentificationError

CoupledJoints = Sequence[tuple[str, str]]
"""Pairs of a joint and its driver, the joint whose motion it feels."""


def coupled_terms(
    joint_names: Sequence[str], coupled: CoupledJoints
) -> tuple[tuple[JointTerm, ...], ...]:
    """Return the columns that couplings add to each joint.

    A drive that passes another joint, as in many wrists, is turned by it: the joint's torque
    gets `cv dq + ca ddq` of its driver. Where the torque acts both ways, give both pairs.

    Parameters
    ----------
    joint_names : sequence of n str
    coupled : sequence of (joint, driver)

    Returns
    -------
    tuple of n tuples of JointTerm

    Raises
    ------
    IdentificationError
        If the arm lacks a joint, or one is to drive itself.
    """
    terms: list[list[JointTerm]] = [[] for _ in joint_names]
    for joint, driver in dict.fromkeys(coupled):
        unknown = [name for name in (joint, driver) if name not in joint_names]
        if unknown:
            raise IdentificationError(
                f'coupled joints {joint}, {driver}: no joint {", ".join(unknown)}: the arm has '
                f'{", ".join(joint_names)}'
            )
        if joint == driver:
            raise IdentificationError(
                f'coupled joints {joint}, {driver}: a joint is coupled to another one, its own '
                'friction and rotor are there anyway'
            )
        index = list(joint_names).index(driver)
        terms[list(joint_names).index(joint)] += [JointTerm(k, driver=index) for k in COUPLED]
    return tuple(map(tuple, terms))
