"""Figures of the identification report."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import NOT_FRICTION, JointTerm
from aerarm_ros.identification.recording.recording import DesiredVelocity
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.plots import MOST_POINTS, StackedFigure

_SEGMENTS = 4  # number of disjoint segments in a motion


class Curve(NamedTuple):
    """Values (M, n), name, and style of a curve over time."""

    values: Array
    name: str
    role: str
    dash: str = 'solid'


def amplitude_density(values: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies and amplitude spectral density, averaged over segments (Welch).

    Parameters
    ----------
    values : (M,) ndarray
        Evenly sampled values; M at least 8.
    dt : float
        Sampling time [s].

    Returns
    -------
    frequency, density : (K,) ndarray
        Frequency [Hz], and density [unit/sqrt(Hz)]; its squared integral is the variance.
    """
    # Local import, because scipy.signal takes longer to import than the rest of this module.
    from scipy.signal import welch

    length = max(8, len(values) // _SEGMENTS)
    frequency, power = welch(
        values - values.mean(), 1.0 / dt, nperseg=length, noverlap=length - length // 2,
        detrend=False,
    )  # fmt: skip
    return np.asarray(frequency), np.asarray(np.sqrt(power))


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


def spectrum_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    """Return a figure of the spectra of measured torque and its residual."""
    figure = StackedFigure(
        result.robot.joint_names, 'Nm/√Hz', 'frequency [Hz]', True, points(result)
    )
    samples, kept = bag.samples, bag.samples.kept
    dt = float(np.median(np.diff(samples.time)))
    below = 1.5 * result.conditioner.cutoff
    for joint in range(result.robot.n):
        tau = samples.tau[kept, joint]
        for values, name, role in (
            (tau, 'measured, filtered', 'measured'),
            (tau - predicted[kept, joint], 'residual of sdp', 'residual'),
        ):
            frequency, density = amplitude_density(values, dt)
            shown = (frequency > 0.0) & (frequency < below)
            figure.add(joint, frequency[shown], density[shown], name, role)
    return figure


def velocity_curves(bag: SampleColumns, desired: DesiredVelocity | None) -> list[Curve]:
    """Return curves of measured and, if known, commanded velocity."""
    curves = [Curve(bag.samples.dq, 'measured', 'measured')]
    if desired is not None:
        columns = [np.interp(bag.samples.time, desired.time, column) for column in desired.dq.T]
        curves.append(Curve(np.column_stack(columns), 'desired', 'predicted'))
    return curves


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
