"""Friction torque against speed, and how certain it is, whatever terms the model has."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.parameters.joint_term import COUPLED, JointTerm, TermKind

Array = npt.NDArray[np.float64]

_SHARES = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # of a joint's top speed
NO_FRICTION = (TermKind.ROTOR, TermKind.OFFSET, *COUPLED)
"""Terms that are no friction."""


@dataclass(frozen=True, eq=False)
class FrictionDeviations:
    """Standard deviations of each joint's friction torque, the mean of both directions.

    Attributes
    ----------
    speeds : (n, K) ndarray
        Rising to the top speed of the motion [rad/s].
    loads : (n,) ndarray
        Usual torque on the links [Nm], for friction that grows with it.
    torques : (n, K) ndarray
        [Nm]
    """

    speeds: Array
    loads: Array
    torques: Array


def friction_torque(terms: Mapping[JointTerm, float], speed: Array, load: float) -> Array:
    """Return a joint's friction torque at some speeds (K,), the mean of both directions [Nm].

    Parameters
    ----------
    terms : mapping
        Term to coefficient; those of `NO_FRICTION` are left out.
    speed : (K,) ndarray
        [rad/s], positive.
    load : float
        Torque on the links [Nm].
    """
    torque = np.zeros(len(speed))
    for term, value in terms.items():
        if term.kind not in NO_FRICTION:
            torque += value * _both_ways(term, speed, load)
    return torque


def friction_deviations(result: IdentificationResult) -> FrictionDeviations:
    """Return how certain the friction of the recommended estimate is, by data and prior."""
    model, inertial = result.fit.model, result.recommended.estimate.inertial.ravel()
    covariance = result.fit.covariance[10 * model.n :, 10 * model.n :]
    loads = [np.abs(bag.links_torque(inertial)) for bag in result.identification]
    usual = np.median(np.concatenate(loads), axis=0)
    top = np.max([np.abs(bag.samples.dq).max(axis=0) for bag in result.identification], axis=0)
    speeds = np.outer(top, _SHARES)
    torques = np.zeros_like(speeds)
    for joint in range(model.n):
        own = [
            (index, term)
            for index, (owner, term) in enumerate(model.joint_columns)
            if owner == joint and term.kind not in NO_FRICTION
        ]
        if own:
            index = [i for i, _ in own]
            load = float(usual[joint])
            columns = np.column_stack([_both_ways(t, speeds[joint], load) for _, t in own])
            variance = np.einsum('ij,jk,ik->i', columns, covariance[np.ix_(index, index)], columns)
            torques[joint] = np.sqrt(np.maximum(variance, 0.0))
    return FrictionDeviations(speeds, usual, torques)


def _both_ways(term: JointTerm, speed: Array, load: float) -> Array:
    carried, still = np.full(len(speed), load), np.zeros(len(speed))
    ahead, back = (term.basis(way * speed, still, carried) for way in (1.0, -1.0))
    return np.asarray(0.5 * (ahead - back))
