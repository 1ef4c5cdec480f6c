"""Comparison of an estimate with the true parameters of a simulated arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import read_plain
from aerarm_ros.identification.errors import IdentificationError, readable
from aerarm_ros.identification.identification_result import torque_errors
from aerarm_ros.identification.joint_model import JointModel, TermKind
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class Truth:
    """True parameters of a simulated arm.

    Attributes
    ----------
    parameters : mapping
        Values by column name ('m_link1', 'fv_joint1', ...).
    load_friction : (n,) ndarray
        Dry friction per torque on the links.
    measured_per_true_torque : (n,) ndarray
        Ratio of measured to true torque. Measured torques are computed from currents with the
        nominal torque constant, from which the motor's torque constant deviates. Identification
        yields parameters of the measured torque, because the data do not contain this ratio.
    """

    parameters: Mapping[str, float]
    load_friction: Array
    measured_per_true_torque: Array

    def vector(self, model: JointModel) -> Array:
        """Return the true parameter vector in the order of `model.columns`; 0 for unknown terms."""
        theta = np.array([self.parameters.get(name, 0.0) for name in model.columns])
        for index, (joint, term) in enumerate(model.joint_columns, start=10 * model.n):
            if term.kind is TermKind.LOAD:
                theta[index] = self.load_friction[joint]
        return theta

    def names(self, model: JointModel) -> npt.NDArray[np.bool_]:
        """Return a mask (p,) of the columns in `model.columns` that have a known true value."""
        loads = [term.kind is TermKind.LOAD for _, term in model.joint_columns]
        known = [name in self.parameters for name in model.columns]
        named: npt.NDArray[np.bool_] = np.array(known) | ([False] * (10 * model.n) + loads)
        return named


@dataclass(frozen=True, eq=False)
class InertialTorqueError:
    """Error of the estimated torque of links and rotors along a motion.

    Attributes
    ----------
    total : float
        Error over all joints stacked [%], relative to the true torque multiplied by the ratio of
        measured to true torque.
    per_joint : (n,) ndarray
        Error of each joint [%].
    total_absolute : float
        Error over all joints stacked [%], relative to the true torque.
    """

    solver: str
    bag: str
    total: float
    per_joint: Array
    total_absolute: float


def load_truth(path: Path, model: JointModel) -> Truth:
    """Read a file of true parameters written by the simulated boards.

    Raises
    ------
    IdentificationError
        If the file cannot be read or lacks a parameter of the arm.
    """
    with readable(path):
        try:
            return _truth(read_plain(path), model)
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            reason = ' '.join(str(error).split())
            raise IdentificationError(
                f'{path} is not a file of true parameters of this arm ({reason}): pass the '
                'truth_file of the simulation'
            ) from None


def _truth(document: Any, model: JointModel) -> Truth:
    parameters = {str(key): float(value) for key, value in document['parameters'].items()}
    missing = [name for name in model.columns[: 10 * model.n] if name not in parameters]
    if missing:
        raise ValueError(f'no {missing[0]}')

    def column(key: str, default: float) -> Array:
        values = np.array(document.get(key, [default] * model.n), dtype=float)
        if values.shape != (model.n,):
            raise ValueError(f'{key} has {values.size} values, but the arm has {model.n} joints')
        return values

    return Truth(parameters, column('load_friction', 0.0), column('measured_per_true_torque', 1.0))


def inertial_torque_errors(
    truth: Truth, estimates: Sequence[Estimate], bags: Sequence[SampleColumns]
) -> list[InertialTorqueError]:
    """Return the error of the estimated link and rotor torque along the motion of each bag."""
    results = []
    for bag in bags:
        for estimate in estimates:
            kept = bag.samples.kept
            true = _inertial_torque(bag, truth.vector(estimate.model), estimate.model)[kept]
            found = _inertial_torque(bag, estimate.theta, estimate.model)[kept]
            total, per_joint = torque_errors(true * truth.measured_per_true_torque, found)
            absolute, _ = torque_errors(true, found)
            results.append(
                InertialTorqueError(estimate.solver, bag.samples.name, total, per_joint, absolute)
            )
    return results


def _inertial_torque(bag: SampleColumns, theta: Array, model: JointModel) -> Array:
    torque = bag.links_torque(theta[: 10 * model.n])
    for index, (joint, term) in enumerate(model.joint_columns, start=10 * model.n):
        if term.kind is TermKind.ROTOR:
            torque[:, joint] += theta[index] * bag.samples.ddq[:, joint]
    return torque
