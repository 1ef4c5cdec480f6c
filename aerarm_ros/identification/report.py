"""The report: one HTML file that needs nothing else to be read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.figure import StackedFigure, plotting_script
from aerarm_ros.identification.html_text import Html, bullets, page, paragraph, section
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.report_tables import (
    bags_of,
    base_parameter_table,
    conditioning_tables,
    error_table,
    friction_tables,
    joint_error_table,
    parameter_table,
    truth_table,
)
from aerarm_ros.identification.sample_columns import SampleColumns
from aerarm_ros.identification.truth import InertialTorqueError, Truth

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DesiredVelocity:
    """Commanded joint velocities of a bag: `time` (K,) [s] since its start, `dq` (K, n) [rad/s]."""

    time: Array
    dq: Array


@dataclass(frozen=True, eq=False)
class ReportExtras:
    """What the report shows besides the result.

    Attributes
    ----------
    desired : mapping
        Name of a bag to its commanded velocities.
    truth : Truth or None
        True parameters of a simulated arm.
    truth_errors : sequence of InertialTorqueError
    """

    desired: Mapping[str, DesiredVelocity] = field(default_factory=dict)
    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()


def report_html(result: IdentificationResult, extras: ReportExtras) -> str:
    """Return the whole report as HTML, offline and self-contained.

    Raises
    ------
    IdentificationError
        If the plotting script isn't installed.
    """
    robot = result.robot
    body = [paragraph(_headline(result), 'lead')]
    if result.warnings:
        body.append(bullets(result.warnings, 'warnings'))
    body += [
        section('Torque errors', paragraph(_METRIC, 'note'), error_table(result)),
        section('Torque errors joint by joint', joint_error_table(result)),
    ]
    if extras.truth_errors:
        body.append(
            section(
                'Against the true parameters',
                paragraph(_TRUTH, 'note'),
                truth_table(extras.truth_errors, robot.joint_names),
            )
        )
    body += _figures(result, extras)
    body += [
        section(
            'Parameters', paragraph(_PARAMETERS, 'note'), parameter_table(result, extras.truth)
        ),
        section(
            'Base parameters', paragraph(_BASE, 'note'), base_parameter_table(result, extras.truth)
        ),
        section('Friction models', friction_tables(result)),
        section('Conditioning and excitation', conditioning_tables(result)),
    ]
    return page(f'Identification of {robot.model.name}', plotting_script(), body)


_METRIC = (
    'Thesis (5.3): 100 |τ − Φθ| / |τ| over all joints stacked, in percent. Filtered: measured '
    'torque and prediction have passed the same zero-phase low-pass. Raw: torque as recorded. '
    'cad: as drawn; ols: ordinary least squares on the base parameters; wls: weighted by each '
    "joint's noise; sdp: semidefinite program, every link physically consistent, close to CAD "
    'where the motion says nothing. sdp is the one written to estimate.yaml and identified.urdf.'
)
_TRUTH = (
    'Torque that links and rotors need along each motion, against that of the true parameters '
    'of the simulated arm. Measured torque is current times the nominal torque constant; the '
    'truth is scaled by what this constant is off, because no data can show it. The last '
    'column compares without this scaling.'
)
_PARAMETERS = (
    "About the frame of each link's joint, in the order of thesis (3.3), (3.5). From data: 0 % "
    'means that only the prior about CAD determines the value, 100 % that only the measured '
    'torque does. Unidentifiable parameters of ols are those of CAD.'
)
_BASE = (
    'Combinations that the torque depends on, each named after its first parameter. Standard '
    'deviations by the data alone, with correlated residuals taken into account.'
)


def _headline(result: IdentificationResult) -> str:
    def error(name: str) -> float:
        solution = result.solutions[name]
        bags = solution.validation or solution.identification
        return float(np.mean([bag.filtered for bag in bags]))

    role = 'validation' if result.validation else 'identification'
    cad, sdp = error('cad'), error('sdp')
    better = f', {cad / sdp:.1f} times less' if 0.0 < sdp < cad else ''
    consistent = result.recommended.estimate.physically_consistent
    return (
        f'Torque error on {role}: {sdp:.2f} % with the identified model, {cad:.2f} % with the CAD '
        f'model{better}. The identified model is {"" if consistent else "not "}physically '
        'consistent.'
    )


def _figures(result: IdentificationResult, extras: ReportExtras) -> list[Html]:
    parts = []
    assessments = bags_of(result.recommended)
    columns = [*result.identification, *result.validation]
    for index, ((role, assessment), bag) in enumerate(zip(assessments, columns, strict=True)):
        title = f'{role.capitalize()} {assessment.bag}'
        cad = bags_of(result.solutions['cad'])[index][1].prediction.filtered
        parts.append(
            section(
                f'{title}: measured and predicted torque',
                _torque_figure(result, bag, assessment.prediction.filtered, cad).html(
                    f'tau-{index}'
                ),
            )
        )
        desired = extras.desired.get(assessment.bag)
        parts.append(
            section(
                f'{title}: velocities',
                _velocity_figure(result, bag, desired).html(f'dq-{index}'),
            )
        )
    return parts


def _torque_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array, cad: Array
) -> StackedFigure:
    figure = StackedFigure(result.robot.joint_names, 'Nm')
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.tau[kept, joint], 'measured, filtered', 'measured')
        figure.add(joint, time, cad[kept, joint], 'predicted, CAD', 'reference', 'dot')
        figure.add(joint, time, predicted[kept, joint], 'predicted, sdp', 'predicted')
    return figure


def _velocity_figure(
    result: IdentificationResult, bag: SampleColumns, desired: DesiredVelocity | None
) -> StackedFigure:
    figure = StackedFigure(result.robot.joint_names, 'rad/s')
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        if desired is not None:
            wanted = np.interp(time, desired.time, desired.dq[:, joint])
            figure.add(joint, time, wanted, 'desired', 'reference', 'dash')
        figure.add(joint, time, samples.dq[kept, joint], 'measured', 'predicted')
    return figure
