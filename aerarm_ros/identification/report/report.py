"""Report of an identification as one self-contained HTML file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from aerarm_ros.identification.arm_parameters import inertia_boxes
from aerarm_ros.identification.files.summary import ExportError
from aerarm_ros.identification.identification_result import IdentificationResult, geometry_text
from aerarm_ros.identification.recording.recording import BagFacts, DesiredVelocity
from aerarm_ros.identification.report import report_figures as figures
from aerarm_ros.identification.report import report_tables as tables
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import (
    Html,
    bullets,
    folded,
    markup,
    origin,
    page,
    paragraph,
    section,
    table,
)
from aerarm_ros.pages.plots import figure_html, plain_text, plotting_script

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.energy.energy_model import EnergyBalance
    from aerarm_ros.identification.files.estimate_comparison import (
        EstimateChange,
        EstimateComparison,
    )
    from aerarm_ros.identification.payload import Payload
    from aerarm_ros.identification.truth import InertialTorqueError, Truth

_NUMBER = re.compile(r'[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')


def grouped_warnings(warnings: Iterable[str], names: Sequence[str]) -> Html:
    """Return an HTML list of warnings; warnings of one kind are folded into one entry.

    Parameters
    ----------
    names : sequence of str
        Names of joints, links and bags; warnings of one kind differ only in these names.
    """
    longest_first = sorted((re.escape(name) for name in names if name), key=len, reverse=True)
    name = re.compile('|'.join(longest_first)) if longest_first else None
    kinds: dict[str, list[str]] = {}
    for text in warnings:
        kind = name.sub('@', text) if name else text
        kinds.setdefault(_NUMBER.sub('#', kind), []).append(text)
    items = []
    for texts in kinds.values():
        more = folded(f'{len(texts) - 1} similar warnings', bullets(texts[1:])) if texts[1:] else ''
        items.append(Html(markup(texts[0]) + more))
    return bullets(items, 'warnings')


# Twelve triangles of a box whose corners are numbered as in `corners`, x slowest.
_TRIANGLES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)
_EYE = {'x': 2.9, 'y': 2.9, 'z': 1.0}  # camera position that shows all of an upright arm
_BEFORE, _AFTER, _ARM = '#d0672b', '#0b62c4', '#1c2430'


def inertia_view(result: IdentificationResult) -> Html:
    """Return a figure of the inertia boxes of all links, from CAD and as estimated.

    Links whose estimate is physically impossible are shown without a box of the estimate.
    """
    robot = result.robot
    q = result.identification[0].samples.q.mean(axis=0)
    poses = np.array([Kinematics(robot, link).transform(q) for link in robot.link_names])
    traces: list[dict[str, Any]] = [_skeleton(poses, robot.joint_names)]
    for name, inertial, colour in (
        ('before: CAD', result.cad.inertial, _BEFORE),
        ('after: sdp', result.recommended.estimate.inertial, _AFTER),
    ):
        traces += _boxes(inertial, poses, robot.link_names, name, colour)
    axes = {axis: {'title': {'text': f'{axis[0]} [m]'}} for axis in ('xaxis', 'yaxis', 'zaxis')}
    layout = {
        'height': 640,
        'margin': {'l': 0, 'r': 0, 't': 10, 'b': 0},
        'template': 'none',
        'legend': {'orientation': 'h'},
        'scene': {'aspectmode': 'data', 'camera': {'eye': _EYE}, **axes},
    }
    return figure_html('inertia-boxes', traces, layout)


def _boxes(
    inertial: Array, poses: Array, links: tuple[str, ...], name: str, colour: str
) -> list[dict[str, Any]]:
    traces: list[dict[str, Any]] = []
    corners = inertia_boxes(inertial).corners()
    for link, box, pose, parameters in zip(links, corners, poses, inertial, strict=True):
        if not np.isfinite(box).all():
            continue
        places = (box @ pose[:3, :3].T + pose[:3, 3]).round(5)
        traces.append(
            {
                'type': 'mesh3d',
                **dict(zip('xyz', places.T.tolist(), strict=True)),
                **dict(zip('ijk', _TRIANGLES.T.tolist(), strict=True)),
                'name': name,
                'legendgroup': name,
                'showlegend': not traces,
                'color': colour,
                'opacity': 0.45,
                'flatshading': True,
                'hoverinfo': 'text',
                'text': f'{plain_text(link)}, {name}<br>{parameters[0]:.4g} kg',
            }
        )
    return traces


def _skeleton(poses: Array, joints: tuple[str, ...]) -> dict[str, Any]:
    """Return a curve from the base through the origins of all joints."""
    points = np.vstack([np.zeros(3), poses[:, :3, 3]]).round(5)
    return {
        'type': 'scatter3d',
        'mode': 'lines+markers',
        **dict(zip('xyz', points.T.tolist(), strict=True)),
        'name': 'joints',
        'hoverinfo': 'text',
        'marker': {'size': 4, 'color': _ARM},
        'line': {'width': 6, 'color': _ARM},
        'text': ['base', *map(plain_text, joints)],
    }


_ROW = 17  # [px]
_NAME = 34  # characters of an expression that are shown
_DEVIATIONS = 2.0  # standard deviations on both sides of an estimate: 95 % interval
_FARTHEST = 6.0  # largest shown distance from CAD, in prior standard deviations of CAD


def interval_view(result: IdentificationResult, truth: Truth | None) -> Html:
    """Return a figure of the recommended estimate's base parameters, with 95 % intervals.

    The common scale is the distance from CAD, in prior standard deviations of the CAD values.

    Parameters
    ----------
    truth : Truth or None
        True parameters of a simulated arm, shown in addition.
    """
    base = result.used_base
    names = [_short(text) for text in base.expressions()]
    scale = np.maximum(result.base_prior_deviations, 1e-300)
    cad = base.values(result.cad.vector(result.fit.model))
    found = base.values(result.recommended.estimate.theta)
    place = (found - cad) / scale
    spread = np.minimum(_DEVIATIONS * result.base_deviations / scale, 1e3)
    # Bars of parameters that the motion does not determine would be longer than all others.
    reach = float(np.clip(1.2 * np.abs(place).max(initial=0.0), 1.0, _FARTHEST))
    traces: list[dict[str, Any]] = [
        {
            'type': 'scatter',
            'mode': 'markers',
            'name': 'sdp, 95 %',
            'x': place.round(5).tolist(),
            'y': names,
            'error_x': {'type': 'data', 'array': spread.round(5).tolist()},
            'marker': {'color': '#0b4fa3', 'size': 6},
        }
    ]
    if truth is not None:
        true = (truth.base_values(result.fit, base) - cad) / scale
        known = np.isfinite(true)
        traces.append(
            {
                'type': 'scatter',
                'mode': 'markers',
                'name': 'true',
                'x': true[known].round(5).tolist(),
                'y': [name for name, shown in zip(names, known, strict=True) if shown],
                'marker': {'color': '#0b7a3b', 'symbol': 'x', 'size': 7},
            }
        )
    layout = _bar_layout(len(names), 'distance from CAD in standard deviations')
    layout['legend'] = {'orientation': 'h', 'y': 1.0, 'yanchor': 'bottom'}
    layout['xaxis']['range'] = [-reach, reach]
    return figure_html('intervals', traces, layout)


def _bar_layout(count: int, title: str) -> dict[str, Any]:
    """Return the layout of a figure with one named row per quantity."""
    return {
        'height': _ROW * count + 110,
        'margin': {'l': 260, 'r': 15, 't': 30, 'b': 45},
        'template': 'none',
        'xaxis': {'title': {'text': title}},
        'yaxis': {'autorange': 'reversed', 'tickfont': {'size': 11}, 'type': 'category'},
    }


def _short(expression: str) -> str:
    text = expression if len(expression) <= _NAME else expression[: _NAME - 1] + '…'
    return plain_text(text)


@dataclass(frozen=True, eq=False)
class ReportExtras:
    """Contents of the report that an `IdentificationResult` does not include.

    Attributes
    ----------
    desired : mapping
        Commanded velocities by bag name.
    truth : Truth or None
        True parameters of a simulated arm.
    truth_errors : sequence of InertialTorqueError
        Errors of estimated torques, relative to torques computed with the true parameters.
    payload : Payload or None
        Payload identified from another recording.
    facts : mapping
        Further facts by bag name.
    energy : mapping
        Energy balance by bag name.
    resistances : mapping
        Phase resistance [ohm] by joint name, as used for the energy balance, as text.
    exports : sequence of ExportError
        Torque errors of each exported file.
    """

    desired: Mapping[str, DesiredVelocity] = field(default_factory=dict)
    truth: Truth | None = None
    truth_errors: Sequence[InertialTorqueError] = ()
    payload: Payload | None = None
    facts: Mapping[str, BagFacts] = field(default_factory=dict)
    energy: Mapping[str, EnergyBalance] = field(default_factory=dict)
    resistances: Mapping[str, str] = field(default_factory=dict)
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
        names = [*robot.joint_names, *robot.link_names]
        names += [bag.samples.name for bag in (*result.identification, *result.validation)]
        body.append(grouped_warnings(result.warnings, names))
    body += [
        section(
            'Torque errors',
            paragraph(_metric(result), 'note'),
            tables.error_table(result),
            paragraph(geometry_text(result), 'note'),
        ),
        section('Torque errors per joint', tables.joint_error_table(result)),
        section(
            'What limits accuracy', paragraph(_RESIDUAL, 'note'), tables.residual_table(result)
        ),
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
    if result.rollouts:
        body.append(section('Rollouts', paragraph(_ROLLOUTS, 'note'), tables.rollout_table(result)))
    if extras.payload is not None:
        body.append(section('Payload', tables.payload_table(extras.payload)))
    body += _figures(result, extras)
    body += [
        section('Inertia boxes', paragraph(_BOXES, 'note'), inertia_view(result)),
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
            paragraph(_INTERVALS, 'note'),
            interval_view(result, extras.truth),
            paragraph(_TRUE_BASE, 'note') if extras.truth else '',
            tables.base_parameter_table(result, extras.truth),
        ),
        section(
            'Friction',
            paragraph(_FRICTION, 'note'),
            figures.friction_figure(result).html('friction'),
            tables.friction_tables(result),
        ),
        *_energy(extras, robot.joint_names),
        section(
            'Conditioning and excitation',
            tables.recording_table(extras.facts),
            tables.conditioning_tables(result),
            figures.cutoff_figure(result).html('cutoff'),
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
_THESIS = (
    'solver of the thesis, (3.11) with (3.9), (3.12) and (3.13), which does not ensure physically '
    'consistent links'
)
_SOLVERS = {
    'cad': 'input URDF',
    'cad_friction': 'nominal links and rotors, with identified friction',
    'ols': 'ordinary least squares on the base parameters',
    'wls': "least squares on the base parameters, weighted by each joint's noise",
    'huber': 'like sdp, but with a lower weight for outliers',
    'slsqp': f'{_THESIS}, by sequential quadratic programming',
    'annealing': f'{_THESIS}, by simulated annealing',
    'entropic': 'like sdp, but with an entropic prior that keeps links solid',
    'output_error': 'like sdp, but with joint coefficients for which simulated positions match the '
    'measured positions',
    'sdp': 'semidefinite program with physically consistent links, close to CAD where the motion '
    'gives no information',
}
_ENERGY = (
    'Energy balance of each bag. Winding heat, 3/2 R i², is computed with the configured '
    'resistances. Friction, lifting and motion are computed with the identified model. The rest '
    "is unexplained work, braking energy, and the boards' consumption. The sum is the supplied "
    'energy. The torque is filtered, so the balance lacks torque ripple above the cutoff.'
)
_RESIDUAL = (
    'Causes of the filtered torque residual of the solver sdp, in percent of the mean square of '
    'the residual. Noise: filtered white noise with the level of the upper half of the recorded '
    'spectra. Other causes: fraction of held-out parts of the bag that the typical torque of the '
    'cause explains. Effects that the identifier corrects, such as an estimated delay, are not '
    'part of the residual.'
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
_ROLLOUTS = (
    'Simulation of the arm with the measured torque, from the measured state at the start of each '
    'time window. Columns: RMS position error of each joint over all windows, and error of all '
    'joints relative to their motion. A dash means that the simulation diverges.'
)
_BOXES = (
    'Homogeneous boxes with the mass and inertia of each link, as in thesis figure 5.2c, in the '
    'middle of the identification motion. Before: CAD. After: sdp. Drag to turn; click a name to '
    'hide its boxes.'
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
_INTERVALS = (
    'The figure shows the distance from CAD in standard deviations of the prior. Bars are 95 % '
    'intervals from the data alone. A bar from edge to edge means that the motion does not '
    'excite the parameter.'
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


def _energy(extras: ReportExtras, joint_names: Sequence[str]) -> list[Html]:
    if not extras.energy:
        return []
    used = '; '.join(f'{name} {text}' for name, text in extras.resistances.items())
    note = paragraph(f'{_ENERGY} Resistances of the phases [Ω]: {used}.', 'note')
    return [section('Energy', note, tables.energy_table(extras.energy, joint_names))]


def _metric(result: IdentificationResult) -> str:
    solvers = '; '.join(f'{name}: {_SOLVERS[name]}' for name in result.solutions)
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
        velocities = figures.velocity_curves(bag, extras.desired.get(assessment.bag))
        over_time = partial(figures.time_figure, result, bag)
        spectrum = figures.spectrum_figure(result, bag, predicted)
        for what, name, figure in (
            ('measured and predicted torque', 'tau', over_time('Nm', torques)),
            ('residual over time', 'residual', over_time('Nm', left)),
            ('spectrum of the residual', 'spectrum', spectrum),
            ('velocities', 'dq', over_time('rad/s', velocities)),
        ):
            parts.append(section(f'{title}: {what}', figure.html(f'{name}-{index}')))
    return parts


_SOME = 60.0  # standard deviations above which a bar is truncated


def comparison_page(comparison: EstimateComparison, old: str, new: str) -> str:
    """Return the comparison of two results as HTML that opens offline.

    Parameters
    ----------
    old, new : str
        Names of the two results.

    Raises
    ------
    IdentificationError
        If the plotting script is not installed.
    """
    clear = [change.name for change in comparison.changes if change.is_clear]
    lead = f'{len(clear)} of {len(comparison.changes)} parameters differ by more than three '
    lead += f'standard deviations{": " if clear else ""}{", ".join(clear)}.'
    parts = [paragraph(lead, 'lead')]
    for title, changes in (
        ('Friction', comparison.friction),
        ('Inertia', comparison.inertia),
        ('Drives', comparison.drives),
    ):
        if changes:
            identifier = title.lower()
            parts.append(section(title, _figure(changes, identifier), _table(changes, old, new)))
    if comparison.unmatched:
        parts.append(
            paragraph(
                f'Only one of the two motions determines {comparison.unmatched} parameter sums, '
                'so the comparison omits these sums.',
                'note',
            )
        )
    return page(f'{new} against {old}', plotting_script(), parts, origin())


def _table(changes: tuple[EstimateChange, ...], old: str, new: str) -> Html:
    rows = [
        [c.name, Html(c.unit), c.old, c.new, c.new - c.old, c.std, c.deviations] for c in changes
    ]
    headings = ['', 'unit', old, new, 'difference', 'standard deviation', 'in deviations']
    return table(headings, rows, [i for i, change in enumerate(changes) if change.is_clear])


def _figure(changes: tuple[EstimateChange, ...], identifier: str) -> Html:
    """Return a bar chart of changes of quantities, in standard deviations."""
    trace: dict[str, Any] = {
        'type': 'bar',
        'orientation': 'h',
        'x': [round(max(-_SOME, min(_SOME, c.deviations)), 3) for c in changes],
        'y': [_short(c.name) for c in changes],
        'marker': {'color': ['#b3261e' if c.is_clear else '#a9bdd6' for c in changes]},
    }
    layout = _bar_layout(len(changes), 'difference in standard deviations')
    return figure_html(identifier, [trace], layout)
