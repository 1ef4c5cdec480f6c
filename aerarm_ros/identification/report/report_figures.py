"""Figures of the report, one for each thing that is to be seen of a bag."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.parameters.joint_term import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.recording.desired_velocity import DesiredVelocity
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.report.figure import MOST_POINTS, StackedFigure
from aerarm_ros.identification.report.residual_spectrum import amplitude_density

Array = npt.NDArray[np.float64]

_NO_FRICTION = (TermKind.ROTOR, *COUPLED)
_CURVE = 201  # points of a friction curve, odd: dry friction jumps in the middle
_CLOUD = 600  # measured points behind it
# Of all bags together, and least of one: a report stays below 3 MB for up to a dozen bags.
_POINTS, _FEWEST = 2400, 200


def points(result: IdentificationResult) -> int:
    """Return how many points a curve over time may have: the fewer, the more bags there are."""
    bags = len(result.identification) + len(result.validation)
    return max(_FEWEST, min(MOST_POINTS, _POINTS // bags))


def torque_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array, cad: Array
) -> StackedFigure:
    """Return measured and predicted torque over time, all filtered."""
    figure = StackedFigure(result.robot.joint_names, 'Nm', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.tau[kept, joint], 'measured, filtered', 'measured')
        figure.add(joint, time, cad[kept, joint], 'predicted, CAD', 'reference', 'dot')
        figure.add(joint, time, predicted[kept, joint], 'predicted, sdp', 'predicted')
    return figure


def residual_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    """Return what the model leaves of the torque over time."""
    figure = StackedFigure(result.robot.joint_names, 'Nm', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    for joint in range(result.robot.n):
        left = samples.tau[kept, joint] - predicted[kept, joint]
        figure.add(joint, samples.time[kept], left, 'residual of sdp', 'residual')
    return figure


def spectrum_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    """Return the spectra of measured torque and of what the model leaves of it."""
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


def velocity_figure(
    result: IdentificationResult, bag: SampleColumns, desired: DesiredVelocity | None
) -> StackedFigure:
    """Return measured and, where it is known, commanded velocity over time."""
    figure = StackedFigure(result.robot.joint_names, 'rad/s', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.dq[kept, joint], 'measured', 'measured')
        if desired is not None:
            wanted = np.interp(time, desired.time, desired.dq[:, joint])
            figure.add(joint, time, wanted, 'desired', 'predicted')
    return figure


def friction_figure(result: IdentificationResult) -> StackedFigure:
    """Return each joint's friction against velocity: the model's, and what was measured of it.

    Measured is the torque of the identification bags less that of links and rotors.
    """
    estimate, model = result.recommended.estimate, result.fit.model
    figure = StackedFigure(model.joint_names, 'Nm', 'velocity [rad/s]')
    inertial = estimate.inertial.ravel()
    values = estimate.theta[10 * model.n :]
    for joint in range(model.n):
        own = [
            (term, float(value))
            for (j, term), value in zip(model.joint_columns, values, strict=True)
            if j == joint and term.kind not in _NO_FRICTION
        ]
        dq, torque, load = _measured_friction(result, joint, own, inertial)
        if len(dq):  # of a joint that stands still, or whose effort is dead, nothing is measured
            figure.add(joint, dq, torque, 'measured', 'cloud')
        speed = float(np.abs(dq).max(initial=1e-3)) * np.linspace(-1.0, 1.0, _CURVE)
        carried = np.full(_CURVE, float(np.median(load)) if len(load) else 0.0)
        curve = sum((v * t.basis(speed, carried, carried) for t, v in own), np.zeros(_CURVE))
        figure.add(joint, speed, curve, 'sdp, at the usual load', 'predicted')
        drawn = result.cad.viscous[joint] * speed + result.cad.coulomb[joint] * np.sign(speed)
        figure.add(joint, speed, drawn, 'CAD', 'reference', 'dot')
    return figure


def _measured_friction(
    result: IdentificationResult, joint: int, own: list[tuple[JointTerm, float]], inertial: Array
) -> tuple[Array, Array, Array]:
    """Return velocity, filtered friction and load of some samples of the identification bags."""
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
    dq, torque, load = stacked[:: max(1, -(-len(stacked) // _CLOUD))].T
    return dq, torque, load


def cutoff_figure(result: IdentificationResult) -> StackedFigure:
    """Return the held-out error of the filters that were tried, against their cut-off."""
    figure = StackedFigure(('error',), '%', 'cut-off [Hz]')
    choice = result.filter_choice
    groups: dict[str, list[tuple[float, float]]] = {}
    for trial in choice.trials:
        groups.setdefault(trial.kinematics.source, []).append((trial.cutoff, trial.error))
    roles = ('predicted', 'reference', 'residual')
    for role, (source, points) in zip(roles, groups.items(), strict=False):
        cutoffs, errors = np.array(sorted(points)).T
        figure.add(0, cutoffs, errors, source, role, marked=True)
    chosen = [t.error for t in choice.trials if t.kinematics == choice.kinematics]
    if chosen:
        place = np.array([choice.conditioner.cutoff])
        figure.add(0, place, np.array(chosen[:1]), 'chosen', 'cloud')
    return figure
