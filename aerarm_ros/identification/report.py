"""Report of an identification as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from aerarm_ros.identification import report_tables as tables
from aerarm_ros.identification.files.summary import ExportError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.identification.solvers.solvers import SOLVERS
from aerarm_ros.pages.html_text import Html, bullets, origin, page, paragraph, section
from aerarm_ros.pages.plots import plotting_script

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.payload import Payload
    from aerarm_ros.identification.truth import InertialTorqueError, Truth

import numpy as np

from aerarm_ros.identification.joint_model import NOT_FRICTION, JointTerm
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.plots import MOST_POINTS, StackedFigure


@dataclass(frozen=True, eq=False)
class ReportExtras:
    """Contents of the report that an `IdentificationResult` does not include.

    Attributes
    ----------
    truth : Truth or None
        True parameters of a simulated arm.
    truth_errors : sequence of InertialTorqueError
        Errors of estimated torques, relative to torques computed with the true parameters.
    payload : Payload or None
        Payload identified from another recording.
    facts : mapping
        Further facts by bag name.
    exports : sequence of ExportError
        Torque errors of each exported file.
    """

    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()
    payload: Payload | None = None
    facts: Mapping[str, BagFacts] = field(default_factory=dict)
    exports: Sequence[ExportError] = ()


def report_html(result: IdentificationResult, extras: ReportExtras) -> str:
    """Return the complete report as self-contained HTML that opens offline.

    Raises
    ------
    IdentificationError
        If the plotting script is not installed.
    """
    truth, joints = extras.truth, result.robot.joint_names
    body = [paragraph(_headline(result), 'lead')]
    if result.warnings:
        body.append(bullets(result.warnings, 'warnings'))
    body += [
        section('Torque errors', _note(_metric(result)), tables.error_table(result)),
        section('Torque errors per joint', tables.joint_error_table(result)),
    ]
    if extras.exports:
        files = tables.export_table(result, extras.exports)
        body.append(section('Torque errors of the written files', _note(_EXPORTS), files))
    if extras.truth_errors:
        errors = tables.truth_table(extras.truth_errors, joints)
        body.append(section('Comparison with the true parameters', _note(_TRUTH), errors))
    if extras.payload is not None:
        body.append(section('Payload', tables.payload_table(extras.payload)))
    body += _time_figures(result)
    body += [
        section(
            'Parameters',
            *(_note(_PARAMETERS), _note(_only_prior(result))),
            _note(_TRUE_PARAMETERS) if truth else '',
            tables.parameter_table(result, truth),
        ),
        section('Base parameters', *(_note(_BASE), tables.base_parameter_table(result))),
        section(
            'Friction',
            *(_note(_FRICTION), friction_figure(result).html('friction')),
            tables.friction_table(result),
        ),
        section(
            'Conditioning and excitation',
            *(tables.recording_table(extras.facts), tables.conditioning_tables(result)),
            *(_note(_EXCITATION), tables.excitation_table(result)),
        ),
    ]
    title = f'Identification of {result.robot.model.name}'
    return page(title, plotting_script(), body, origin())


def _note(text: str) -> Html:
    return paragraph(text, 'note')


_METRIC = (
    'Torque error of thesis (5.3): 100 |τ − Φθ| / |τ| over all joints, in percent, with measured '
    'torque τ and predicted torque Φθ. Filtered: both torques are filtered by the same zero-phase '
    'low-pass. Measured filtered: only the measured torque is filtered, as in most publications. '
    'Raw: no torque is filtered.'
)
_EXPORTS = (
    'Filtered torque error of the model in each written file, on the same bags. The file formats '
    'contain different terms. Only estimate.yaml contains offsets and friction beyond thesis '
    '(2.6). URDF contains no rotors. URDF and SDF contain no gravity.'
)
_TRUTH = (
    'Error of the estimated torque of links and rotors along each motion, relative to the torque '
    'with the true parameters of the simulated arm. Measured torque is current times the nominal '
    'torque constant, and no data can reveal an error of this constant. For comparison, the true '
    'torque is therefore multiplied by the relative error of the constant. The last column shows '
    'the error without this scaling.'
)
_PARAMETERS = (
    "Parameters in the frame of each link's joint, in the order of thesis (3.3) and (3.5). From "
    'data: 0 % if only the CAD prior determines the value, 100 % if only the measured torque does. '
    'In a sum: the torque depends only on a sum of this and other parameters, so the CAD prior '
    'determines the single values. Column ols: unidentifiable parameters have CAD values.'
)
_BASE = (
    'Parameter combinations that determine the torque, each named after its first parameter. '
    'Standard deviations follow from the data alone, and account for correlated residuals. '
    "Excitation is the standard deviation of the CAD prior divided by the data's standard "
    'deviation. Below about 3, the motion contains little information about the parameter.'
)
_FRICTION = (
    'Points are measured torque minus the modelled torque of links and rotors, both low-pass '
    'filtered. The filter smooths the friction step at standstill. The line is the friction model, '
    'at the median load if friction depends on the load.'
)
_TRUE_PARAMETERS = (
    'True: parameters of the simulated arm. The identified values include the errors of the torque '
    'constants, so even an estimate without error differs from the true values.'
)
_EXCITATION = (
    "Excess of each bag's motion over the range of the identification motion, and uncertainty of "
    'the predicted torque due to uncertain parameters. If this uncertainty exceeds the noise, the '
    'torque of the bag depends on parameters that the identification motion did not excite.'
)


def _metric(result: IdentificationResult) -> str:
    solvers = '; '.join(f'{name}: {SOLVERS[name].text}' for name in result.solutions)
    return f'{_METRIC} {solvers}. estimate.yaml and identified.urdf contain the result of sdp.'


def _headline(result: IdentificationResult) -> str:
    recommended = result.recommended
    role = 'validation' if recommended.validation else 'identification'
    bags, cad, drawn = (
        getattr(solution, role)
        for solution in (recommended, *(result.solutions[n] for n in ('cad', 'cad_friction')))
    )
    worst = max(range(len(bags)), key=lambda index: bags[index].filtered)
    found = bags[worst]
    cad_error, drawn_error = cad[worst].filtered, drawn[worst].filtered
    which = f'{found.bag} ({role})'
    if len(bags) > 1:
        which += f', the worst of {len(bags)} {role} bags'
    better = (
        f' ({drawn_error / found.filtered:.1f} times as high)'
        if 0 < found.filtered < drawn_error
        else ''
    )
    consistent = recommended.estimate.physically_consistent
    return (
        f'Torque error of the identified model on {which}: {found.filtered:.2f} % filtered '
        f'({found.filtered_measured:.2f} % with only the measured torque filtered, '
        f'{found.raw:.2f} % without filter). For comparison, the filtered error is '
        f'{cad_error:.2f} % with the CAD model, and {drawn_error:.2f} % with the CAD model and '
        f'identified friction{better}. The '
        f'identified model is {"" if consistent else "not "}physically consistent.'
    )


def _only_prior(result: IdentificationResult) -> str:
    if not result.only_prior:
        return 'The data contain information about every parameter.'
    return f'Only the CAD prior determines {", ".join(result.only_prior)}.'


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
