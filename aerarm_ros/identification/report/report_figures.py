"""Figures of the identification report."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import NOT_FRICTION, JointTerm
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.plots import MOST_POINTS, StackedFigure


class Curve(NamedTuple):
    """Values (M, n), name, and style of a curve over time."""

    values: Array
    name: str
    role: str
    dash: str = 'solid'


_CURVE = 201  # number of points of a friction curve, odd because dry friction jumps in the middle
_CLOUD_SIZE = 600  # number of measured points in the background
# Number of points of all bags together, and smallest number per bag; the figures of a dozen bags
# then fit into 3 MB.
_POINTS, _FEWEST = 2400, 200


def points(result: IdentificationResult) -> int:
    """Return the number of points per curve over time; with more bags, each curve has fewer."""
    bags = len(result.identification) + len(result.validation)
    return max(_FEWEST, min(MOST_POINTS, _POINTS // bags))


def time_figure(
    result: IdentificationResult, bag: SampleColumns, unit: str, curves: Sequence[Curve]
) -> StackedFigure:
    """Return a figure of curves over the time of a bag.

    Parameters
    ----------
    curves : sequence of Curve
        Curves with values (M, n) at all samples of the bag.
    """
    figure = StackedFigure(result.robot.joint_names, unit, most=points(result))
    kept = bag.samples.kept
    for joint in range(result.robot.n):
        for values, name, role, dash in curves:
            figure.add(joint, bag.samples.time[kept], values[kept, joint], name, role, dash)
    return figure


def friction_figure(result: IdentificationResult) -> StackedFigure:
    """Return a figure of each joint's modelled and measured friction torque over velocity.

    Measured friction is the torque measured in the identification bags, minus the modelled torque
    of links and rotors.
    """
    estimate, model = result.recommended.estimate, result.fit.model
    figure = StackedFigure(model.joint_names, 'Nm', 'velocity [rad/s]')
    inertial = estimate.inertial.ravel()
    values = estimate.theta[10 * model.n :]
    for joint in range(model.n):
        own = [
            (term, float(value))
            for (j, term), value in zip(model.joint_columns, values, strict=True)
            if j == joint and term.kind not in NOT_FRICTION
        ]
        dq, torque, load = _measured_friction(result, joint, own, inertial)
        if len(dq):  # empty for a joint at rest or with constant effort
            figure.add(joint, dq, torque, 'measured', 'cloud')
        speed = float(np.abs(dq).max(initial=1e-3)) * np.linspace(-1.0, 1.0, _CURVE)
        carried = np.full(_CURVE, float(np.median(load)) if len(load) else 0.0)
        curve = sum((v * t.basis(speed, carried, carried) for t, v in own), np.zeros(_CURVE))
        figure.add(joint, speed, curve, 'solver sdp, at the median load', 'predicted')
        drawn = result.cad.viscous[joint] * speed + result.cad.coulomb[joint] * np.sign(speed)
        figure.add(joint, speed, drawn, 'CAD', 'reference', 'dot')
    return figure


def _measured_friction(
    result: IdentificationResult, joint: int, own: list[tuple[JointTerm, float]], inertial: Array
) -> tuple[Array, Array, Array]:
    """Return velocity, filtered friction torque and load of selected identification samples."""
    parts = []
    assessed = result.recommended.identification
    for bag, errors in zip(result.identification, assessed, strict=True):
        samples = bag.samples
        rows = samples.usable[:, joint]
        friction = samples.tau[:, joint] - errors.prediction.filtered[:, joint]
        for term, value in own:
            friction = friction + value * bag.term(term, inertial)[:, joint]
        load = np.abs(bag.links_torque(inertial)[:, joint])
        parts.append(np.column_stack([samples.dq[:, joint], friction, load])[rows])
    stacked = np.vstack(parts)
    dq, torque, load = stacked[:: max(1, -(-len(stacked) // _CLOUD_SIZE))].T
    return dq, torque, load
