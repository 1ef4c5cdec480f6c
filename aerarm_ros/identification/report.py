"""Report of an identification as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.identification import report_tables as tables
from aerarm_ros.identification.files.summary import ReportExtras
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import NOT_FRICTION, JointTerm
from aerarm_ros.identification.solvers.solvers import SOLVERS
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import Html, bullets, macros, origin, page, section
from aerarm_ros.pages.plots import MOST_POINTS, StackedFigure, plotting_script


def report_html(result: IdentificationResult, extras: ReportExtras) -> str:
    """Return the complete report as self-contained HTML that opens offline.

    Raises
    ------
    IdentificationError
        If the plotting script is not installed.
    """
    texts, truth = macros(_TEXTS), extras.truth
    body = [_headline(texts, result)]
    if result.warnings:
        body.append(bullets(result.warnings, 'warnings'))
    solvers = '; '.join(f'{name}: {SOLVERS[name].text}' for name in result.solutions)
    body += [
        section('Torque errors', texts.metric(solvers), tables.error_table(result)),
        section('Torque errors per joint', tables.joint_error_table(result)),
    ]
    if extras.exports:
        files = tables.export_table(result, extras.exports)
        body.append(section('Torque errors of the written files', texts.exports(), files))
    if extras.truth_errors:
        errors = tables.truth_table(extras.truth_errors, result.robot.joint_names)
        body.append(section('Comparison with the true parameters', texts.truth(), errors))
    if extras.payload is not None:
        body.append(section('Payload', tables.payload_table(extras.payload)))
    body += _time_figures(result)
    about = texts.parameters(result.only_prior, truth is not None)
    friction = friction_figure(result).html('friction')
    conditioning = tables.recording_table(extras.facts), tables.conditioning_tables(result)
    excitation = texts.excitation(), tables.excitation_table(result)
    body += [
        section('Parameters', about, tables.parameter_table(result, truth)),
        section('Base parameters', texts.base(), tables.base_parameter_table(result)),
        section('Friction', texts.friction(), friction, tables.friction_table(result)),
        section('Conditioning and excitation', *conditioning, *excitation),
    ]
    title = f'Identification of {result.robot.model.name}'
    return page(title, plotting_script(), body, origin())


_TEXTS = Path(__file__).with_suffix('.html')


def _headline(texts: Any, result: IdentificationResult) -> Html:
    recommended = result.recommended
    role = 'validation' if recommended.validation else 'identification'
    bags, cad, drawn = (
        getattr(solution, role)
        for solution in (recommended, *(result.solutions[n] for n in ('cad', 'cad_friction')))
    )
    worst = max(range(len(bags)), key=lambda index: bags[index].filtered)
    errors = cad[worst].filtered, drawn[worst].filtered
    consistent = recommended.estimate.physically_consistent
    return Html(texts.headline(role, bags[worst], len(bags), *errors, consistent))


_CURVE = 201  # number of points of a friction curve, odd because dry friction jumps in the middle
_CLOUD_SIZE = 600  # number of measured points in the background
# Number of points of all bags together, and smallest number per bag; the figures of a dozen bags
# then fit into 3 MB.
_POINTS, _FEWEST = 2400, 200


def _time_figures(result: IdentificationResult) -> Iterator[Html]:
    """Yield sections with figures of the torques and the residual of each bag over time.

    With more bags, each curve has fewer points.
    """
    bags = [*result.identification, *result.validation]
    most = max(_FEWEST, min(MOST_POINTS, _POINTS // len(bags)))
    solutions = result.recommended, result.solutions['cad']
    pairs = zip(bags, *map(tables.bags_of, solutions), strict=True)
    for index, (bag, (role, assessed), (_, nominal)) in enumerate(pairs):
        samples, predicted = bag.samples, assessed.prediction.filtered
        torques = [
            (samples.tau, 'measured, filtered', 'measured', 'solid'),
            (nominal.prediction.filtered, 'predicted, CAD', 'reference', 'dot'),
            (predicted, 'predicted, sdp', 'predicted', 'solid'),
        ]
        left = [(samples.tau - predicted, 'residual of sdp', 'residual', 'solid')]
        for what, name, curves in (
            ('measured and predicted torque', 'tau', torques),
            ('residual over time', 'residual', left),
        ):
            figure = StackedFigure(result.robot.joint_names, 'Nm', most=most)
            for joint in range(result.robot.n):
                for values, *style in curves:
                    rows = values[samples.kept, joint]
                    figure.add(joint, samples.time[samples.kept], rows, *style)
            title = f'{assessed.bag} ({role}): {what}'
            yield section(title, figure.html(f'{name}-{index}'))


def friction_figure(result: IdentificationResult) -> StackedFigure:
    """Return a figure of each joint's modelled and measured friction torque over velocity.

    Measured friction is the torque measured in the identification bags, minus the modelled torque
    of links and rotors.
    """
    estimate, model = result.recommended.estimate, result.fit.model
    figure = StackedFigure(model.joint_names, 'Nm', 'velocity [rad/s]')
    inertial = estimate.inertial.ravel()
    for joint in range(model.n):
        terms = model.coefficients(estimate.theta, joint)
        own = [(term, value) for term, value in terms if term.kind not in NOT_FRICTION]
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
