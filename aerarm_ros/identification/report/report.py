"""The report: one HTML file that needs nothing else to be read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.assessment.truth import InertialTorqueError, Truth
from aerarm_ros.identification.payload.payload import Payload
from aerarm_ros.identification.recording.bag_facts import BagFacts
from aerarm_ros.identification.recording.desired_velocity import DesiredVelocity
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.report.figure import StackedFigure, plotting_script
from aerarm_ros.identification.report.html_text import Html, bullets, page, paragraph, section
from aerarm_ros.identification.report.inertia_view import inertia_view
from aerarm_ros.identification.report.report_tables import (
    bags_of,
    base_parameter_table,
    conditioning_tables,
    error_table,
    excitation_table,
    friction_tables,
    joint_error_table,
    parameter_table,
    payload_table,
    recording_table,
    truth_table,
)
from aerarm_ros.identification.report.residual_spectrum import amplitude_density

Array = npt.NDArray[np.float64]


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
    payload : Payload or None
        What the arm carried in another recording.
    facts : mapping
        Name of a bag to what else is known of it.
    """

    desired: Mapping[str, DesiredVelocity] = field(default_factory=dict)
    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()
    payload: Payload | None = None
    facts: Mapping[str, BagFacts] = field(default_factory=dict)


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
        section('Torque errors', paragraph(_metric(result), 'note'), error_table(result)),
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
    if extras.payload is not None:
        body.append(section('Payload', payload_table(extras.payload)))
    body += _figures(result, extras)
    body += [
        section('Inertia boxes', paragraph(_BOXES, 'note'), inertia_view(result)),
        section(
            'Parameters',
            paragraph(_PARAMETERS, 'note'),
            paragraph(_only_prior(result), 'note'),
            paragraph(_TRUE_PARAMETERS, 'note') if extras.truth else '',
            parameter_table(result, extras.truth),
        ),
        section(
            'Base parameters',
            paragraph(_BASE, 'note'),
            paragraph(_TRUE_BASE, 'note') if extras.truth else '',
            base_parameter_table(result, extras.truth),
        ),
        section('Friction models', friction_tables(result)),
        section(
            'Conditioning and excitation',
            recording_table(extras.facts),
            conditioning_tables(result),
            paragraph(_EXCITATION, 'note'),
            excitation_table(result),
        ),
    ]
    return page(f'Identification of {robot.model.name}', plotting_script(), body)


_METRIC = (
    'Thesis (5.3): 100 |τ − Φθ| / |τ| over all joints stacked, in percent. Filtered: measured '
    'torque and prediction have passed the same zero-phase low-pass. Measured filtered: only the '
    'measured torque has, as in most publications. Raw: torque as recorded.'
)
_THESIS = (
    'solver of the thesis, (3.11) with (3.9), (3.12), (3.13), which does not ensure bodies that '
    'can exist'
)
_SOLVERS = {
    'cad': 'as drawn',
    'ols': 'ordinary least squares on the base parameters',
    'wls': "the same weighted by each joint's noise",
    'huber': 'as sdp, with outliers weighted down',
    'slsqp': f'{_THESIS}, by sequential quadratic programming',
    'annealing': f'{_THESIS}, by simulated annealing',
    'entropic': 'as sdp, with an entropic prior, so that links stay solid',
    'sdp': 'semidefinite program, every link physically consistent, close to CAD where the motion '
    'says nothing',
}
_TRUTH = (
    'Torque that links and rotors need along each motion, against that of the true parameters '
    'of the simulated arm. Measured torque is current times the nominal torque constant; the '
    'truth is scaled by what this constant is off, because no data can show it. The last '
    'column compares without this scaling.'
)
_BOXES = (
    'Homogeneous boxes with the mass and inertia of each link, as in thesis figure 5.2c, in the '
    'middle of the identification motion: CAD before, sdp after. Drag to turn; click a name to '
    'hide it.'
)
_PARAMETERS = (
    "About the frame of each link's joint, in the order of thesis (3.3), (3.5). From data: 0 % "
    'means that only the prior about CAD determines the value, 100 % that only the measured '
    'torque does. In a sum: the torque depends on it together with others only, so that the prior '
    'shares it out, however much the data say of the sum. Unidentifiable parameters of ols are '
    'those of CAD.'
)
_BASE = (
    'Combinations that the torque depends on, each named after its first parameter. Standard '
    'deviations by the data alone, with correlated residuals taken into account. Excitation: how '
    'many times less that is than what CAD leaves open; below about 3 the motion says little.'
)
_TRUE_PARAMETERS = (
    'True: of the simulated arm itself. What the torque constants are off is part of what is '
    'identified, so that even an estimate without any error differs by it.'
)
_TRUE_BASE = (
    'True: of the simulated arm itself. As measured: what least squares with the same weights '
    'would find along this motion in the true torque without noise, times what each torque '
    "constant is off. What one joint alone feels is scaled by this joint's factor; what several "
    'feel has no factor of its own. Standard deviations are those of noise: far beyond 3, the '
    'model lacks something, for example friction where a joint turns round, or a delay between '
    'angle and torque. A dash: the truth has no such parameter.'
)
_EXCITATION = (
    'How far each bag leaves the range of the identification motion, and how uncertain the '
    "predicted torque is because the parameters are: above the noise, the bag's motion asks for "
    'what the identification motion has not shown.'
)


def _metric(result: IdentificationResult) -> str:
    solvers = '; '.join(f'{name}: {_SOLVERS[name]}' for name in result.solutions)
    return f'{_METRIC} {solvers}. sdp is the one written to estimate.yaml and identified.urdf.'


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


def _only_prior(result: IdentificationResult) -> str:
    if not result.only_prior:
        return 'The data say something about every parameter.'
    return f'Only the prior about CAD determines {", ".join(result.only_prior)}.'


def _figures(result: IdentificationResult, extras: ReportExtras) -> list[Html]:
    parts = []
    assessments = bags_of(result.recommended)
    columns = [*result.identification, *result.validation]
    for index, ((role, assessment), bag) in enumerate(zip(assessments, columns, strict=True)):
        title = f'{assessment.bag} ({role})'
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
                f'{title}: spectrum of the residual',
                _spectrum_figure(result, bag, assessment.prediction.filtered).html(
                    f'spectrum-{index}'
                ),
            )
        )
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


def _spectrum_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    figure = StackedFigure(result.robot.joint_names, 'Nm/√Hz', 'frequency [Hz]', logarithmic=True)
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


def _velocity_figure(
    result: IdentificationResult, bag: SampleColumns, desired: DesiredVelocity | None
) -> StackedFigure:
    figure = StackedFigure(result.robot.joint_names, 'rad/s')
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.dq[kept, joint], 'measured', 'measured')
        if desired is not None:
            wanted = np.interp(time, desired.time, desired.dq[:, joint])
            figure.add(joint, time, wanted, 'desired', 'predicted')
    return figure
