"""The report: one HTML file that needs nothing else to be read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.assessment.truth import InertialTorqueError, Truth
from aerarm_ros.identification.payload.payload import Payload
from aerarm_ros.identification.recording.bag_facts import BagFacts
from aerarm_ros.identification.recording.desired_velocity import DesiredVelocity
from aerarm_ros.identification.report.grouped_warnings import grouped_warnings
from aerarm_ros.identification.report.inertia_view import inertia_view
from aerarm_ros.identification.report.interval_view import interval_view
from aerarm_ros.identification.report.report_figures import (
    cutoff_figure,
    friction_figure,
    residual_figure,
    spectrum_figure,
    torque_figure,
    velocity_figure,
)
from aerarm_ros.identification.report.report_tables import (
    bags_of,
    base_parameter_table,
    conditioning_tables,
    energy_table,
    error_table,
    excitation_table,
    friction_tables,
    joint_error_table,
    parameter_table,
    payload_table,
    recording_table,
    rollout_table,
    truth_table,
)
from aerarm_ros.pages.html_text import Html, page, paragraph, section
from aerarm_ros.pages.page_origin import origin
from aerarm_ros.pages.plots import plotting_script


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
    energy : mapping
        Name of a bag to where its energy went.
    resistances : mapping
        Name of a joint to the resistance that this was computed with [ohm], as text.
    """

    desired: Mapping[str, DesiredVelocity] = field(default_factory=dict)
    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()
    payload: Payload | None = None
    facts: Mapping[str, BagFacts] = field(default_factory=dict)
    energy: Mapping[str, EnergyBalance] = field(default_factory=dict)
    resistances: Mapping[str, str] = field(default_factory=dict)


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
        names = [*robot.joint_names, *robot.link_names]
        names += [bag.samples.name for bag in (*result.identification, *result.validation)]
        body.append(grouped_warnings(result.warnings, names))
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
    if result.rollouts:
        body.append(section('Rollouts', paragraph(_ROLLOUTS, 'note'), rollout_table(result)))
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
            paragraph(_INTERVALS, 'note'),
            interval_view(result, extras.truth),
            paragraph(_TRUE_BASE, 'note') if extras.truth else '',
            base_parameter_table(result, extras.truth),
        ),
        section(
            'Friction',
            paragraph(_FRICTION, 'note'),
            friction_figure(result).html('friction'),
            friction_tables(result),
        ),
        *_energy(extras, robot.joint_names),
        section(
            'Conditioning and excitation',
            recording_table(extras.facts),
            conditioning_tables(result),
            cutoff_figure(result).html('cutoff'),
            paragraph(_EXCITATION, 'note'),
            excitation_table(result),
        ),
    ]
    return page(f'Identification of {robot.model.name}', plotting_script(), body, origin())


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
    'output_error': "sdp with the joints' coefficients fitted to simulated positions",
    'sdp': 'semidefinite program, every link physically consistent, close to CAD where the motion '
    'says nothing',
}
_ENERGY = (
    'Where the energy of each bag went: heat of the windings, 3/2 R i² with the configured '
    'resistances; friction, lifting and motion by the identified model; work that it does not '
    'explain; braking energy that the power stage burns; what the boards take. They add up to what '
    'the supply gave. From filtered torque, so that ripple above the cut-off is left out.'
)
_TRUTH = (
    'Torque that links and rotors need along each motion, against that of the true parameters '
    'of the simulated arm. Measured torque is current times the nominal torque constant; the '
    'truth is scaled by what this constant is off, because no data can show it. The last '
    'column compares without this scaling.'
)
_ROLLOUTS = (
    'The arm simulated by the measured torque alone, from the measured state at the beginning of '
    'each window: root mean square of the position error along the windows, and the same of all '
    'joints as a share of how far they move within them. A dash: the simulated arm runs away.'
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
_INTERVALS = (
    'In the figure all are on one scale: how far from CAD, in standard deviations of what CAD '
    'leaves open; bars are 95 % by the data alone. A bar from edge to edge: the motion says '
    'nothing of it.'
)
_FRICTION = (
    'Points are measured torque less that of links and rotors, filtered as the torque is, which '
    'rounds the step at standstill. The line is the model, at the usual load where friction grows '
    'with it.'
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


def _energy(extras: ReportExtras, joint_names: Sequence[str]) -> list[Html]:
    if not extras.energy:
        return []
    used = '; '.join(f'{name} {text}' for name, text in extras.resistances.items())
    note = paragraph(f'{_ENERGY} Resistances of the phases [Ω]: {used}.', 'note')
    return [section('Energy', note, energy_table(extras.energy, joint_names))]


def _metric(result: IdentificationResult) -> str:
    solvers = '; '.join(f'{name}: {_SOLVERS[name]}' for name in result.solutions)
    return f'{_METRIC} {solvers}. sdp is the one written to estimate.yaml and identified.urdf.'


def _headline(result: IdentificationResult) -> str:
    recommended = result.recommended
    bags = recommended.validation or recommended.identification
    role = 'validation' if recommended.validation else 'identification'
    worst = max(range(len(bags)), key=lambda index: bags[index].filtered)
    found = bags[worst]
    cad = bags_of(result.solutions['cad'])
    cad_error = [bag.filtered for part, bag in cad if part == role][worst]
    which = f'{found.bag} ({role})'
    if len(bags) > 1:
        which += f', the worst of {len(bags)} {role} bags'
    better = (
        f', {cad_error / found.filtered:.1f} times less' if 0 < found.filtered < cad_error else ''
    )
    consistent = recommended.estimate.physically_consistent
    return (
        f'Torque error on {which}: {found.filtered:.2f} % filtered '
        f'({found.filtered_measured:.2f} % with only the measured one filtered, {found.raw:.2f} % '
        f'raw) with the identified model, {cad_error:.2f} % filtered with the CAD model{better}. '
        f'The identified model is {"" if consistent else "not "}physically consistent.'
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
        predicted = assessment.prediction.filtered
        cad = bags_of(result.solutions['cad'])[index][1].prediction.filtered
        desired = extras.desired.get(assessment.bag)
        for what, name, figure in (
            ('measured and predicted torque', 'tau', torque_figure(result, bag, predicted, cad)),
            ('residual over time', 'residual', residual_figure(result, bag, predicted)),
            ('spectrum of the residual', 'spectrum', spectrum_figure(result, bag, predicted)),
            ('velocities', 'dq', velocity_figure(result, bag, desired)),
        ):
            parts.append(section(f'{title}: {what}', figure.html(f'{name}-{index}')))
    return parts
