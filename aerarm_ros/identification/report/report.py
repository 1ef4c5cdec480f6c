"""Report of an identification as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from aerarm_ros.identification.files.summary import ExportError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.identification.report import report_figures as figures
from aerarm_ros.identification.report import report_tables as tables
from aerarm_ros.identification.solvers.solvers import SOLVERS
from aerarm_ros.pages.html_text import Html, bullets, origin, page, paragraph, section
from aerarm_ros.pages.plots import plotting_script

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.payload import Payload
    from aerarm_ros.identification.truth import InertialTorqueError, Truth


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
    robot = result.robot
    body = [paragraph(_headline(result), 'lead')]
    if result.warnings:
        body.append(bullets(result.warnings, 'warnings'))
    body += [
        section('Torque errors', paragraph(_metric(result), 'note'), tables.error_table(result)),
        section('Torque errors per joint', tables.joint_error_table(result)),
    ]
    if extras.exports:
        body.append(
            section(
                'Torque errors of the written files',
                paragraph(_EXPORTS, 'note'),
                tables.export_table(result, extras.exports),
            )
        )
    if extras.truth_errors:
        body.append(
            section(
                'Comparison with the true parameters',
                paragraph(_TRUTH, 'note'),
                tables.truth_table(extras.truth_errors, robot.joint_names),
            )
        )
    if extras.payload is not None:
        body.append(section('Payload', tables.payload_table(extras.payload)))
    body += _figures(result, extras)
    body += [
        section(
            'Parameters',
            paragraph(_PARAMETERS, 'note'),
            paragraph(_only_prior(result), 'note'),
            paragraph(_TRUE_PARAMETERS, 'note') if extras.truth else '',
            tables.parameter_table(result, extras.truth),
        ),
        section(
            'Base parameters',
            paragraph(_BASE, 'note'),
            paragraph(_TRUE_BASE, 'note') if extras.truth else '',
            tables.base_parameter_table(result, extras.truth),
        ),
        section(
            'Friction',
            paragraph(_FRICTION, 'note'),
            figures.friction_figure(result).html('friction'),
            tables.friction_tables(result),
        ),
        section(
            'Conditioning and excitation',
            tables.recording_table(extras.facts),
            tables.conditioning_tables(result),
            paragraph(_EXCITATION, 'note'),
            tables.excitation_table(result),
        ),
    ]
    return page(f'Identification of {robot.model.name}', plotting_script(), body, origin())


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
_TRUE_BASE = (
    'True: parameter of the simulated arm. As measured: result of the same weighted least-squares '
    'fit to the true torque without noise, multiplied by the error of each torque constant. '
    'Standard deviations account only for noise. A deviation far beyond 3 means that the model '
    'lacks a term, for example friction at reversal, or a delay between angle and torque. A dash '
    'means that the simulated arm has no such parameter.'
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
    bags = recommended.validation or recommended.identification
    role = 'validation' if recommended.validation else 'identification'
    worst = max(range(len(bags)), key=lambda index: bags[index].filtered)
    found = bags[worst]
    cad_error, drawn_error = (
        [bag.filtered for part, bag in tables.bags_of(result.solutions[name]) if part == role][
            worst
        ]
        for name in ('cad', 'cad_friction')
    )
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


def _figures(result: IdentificationResult, extras: ReportExtras) -> list[Html]:
    parts = []
    assessments = tables.bags_of(result.recommended)
    columns = [*result.identification, *result.validation]
    for index, ((role, assessment), bag) in enumerate(zip(assessments, columns, strict=True)):
        title = f'{assessment.bag} ({role})'
        predicted = assessment.prediction.filtered
        cad = tables.bags_of(result.solutions['cad'])[index][1].prediction.filtered
        tau = bag.samples.tau
        torques = [
            figures.Curve(tau, 'measured, filtered', 'measured'),
            figures.Curve(cad, 'predicted, CAD', 'reference', 'dot'),
            figures.Curve(predicted, 'predicted, sdp', 'predicted'),
        ]
        left = [figures.Curve(tau - predicted, 'residual of sdp', 'residual')]
        for what, name, curves in (
            ('measured and predicted torque', 'tau', torques),
            ('residual over time', 'residual', left),
        ):
            figure = figures.time_figure(result, bag, 'Nm', curves)
            parts.append(section(f'{title}: {what}', figure.html(f'{name}-{index}')))
    return parts
