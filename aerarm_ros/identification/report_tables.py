"""Tables of the identification report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from aerarm_ros.identification.files.summary import ExportError, term_text
from aerarm_ros.identification.identification_result import (
    BagAssessment,
    IdentificationResult,
    Solution,
)
from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.model.inertia import PARAMETER_NAMES
from aerarm_ros.pages.html_text import Html, folded, markup, number, table

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.payload import Payload
    from aerarm_ros.identification.truth import InertialTorqueError, Truth

_ERRORS = ('filtered', 'measured filtered', 'raw')
_RIGID_UNITS = ('kg', *['kg m'] * 3, *['kg m²'] * 6)


def bags_of(solution: Solution) -> list[tuple[str, BagAssessment]]:
    """Return the torque errors of each bag, with the bag's role (identification or validation)."""
    roles = ('identification', 'validation')
    return [(role, bag) for role in roles for bag in getattr(solution, role)]


def error_table(result: IdentificationResult) -> Html:
    """Return table 5.1 of the thesis: torque errors of every solver on every bag."""
    bags = bags_of(result.recommended)
    headings: list[object] = ['solver']
    for role, bag in bags:
        name = f'<span class="role">{role}</span><br>{markup(bag.bag)}<br>filtered [%]'
        headings += [Html(name), 'measured filtered [%]', 'raw [%]']
    headings += ['physically consistent', 'smallest pseudo-inertia eigenvalue', 'time [ms]']
    rows = []
    for name, solution in result.solutions.items():
        row: list[object] = [name]
        for _, bag in bags_of(solution):
            row += [bag.filtered, bag.filtered_measured, bag.raw]
        estimate = solution.estimate
        row += [
            Html('yes' if estimate.physically_consistent else 'no'),
            estimate.min_pseudo_inertia_eigenvalue,
            1e3 * estimate.seconds,
        ]
        rows.append(row)
    return table(headings, rows, best=[list(result.solutions).index('sdp')])


def export_table(result: IdentificationResult, exports: Sequence[ExportError]) -> Html:
    """Return the table of torque errors of each exported model file on every bag."""
    bags = [f'{bag.bag} ({role}) [%]' for role, bag in bags_of(result.recommended)]
    rows: list[list[object]] = [[e.file, e.contents, *e.filtered] for e in exports]
    return table(['file', 'file format', *bags], rows)


def joint_error_table(result: IdentificationResult) -> Html:
    """Return the table of torque errors per joint; a click shows the other solvers."""
    names = [f'{name} [%]' for name in result.robot.joint_names]
    shown: list[list[object]] = []
    rows: list[list[object]] = []
    for name, solution in result.solutions.items():
        for role, bag in bags_of(solution):
            errors = bag.per_joint_filtered, bag.per_joint_filtered_measured, bag.per_joint_raw
            for kind, values in zip(_ERRORS, errors, strict=True):
                row: list[object] = [bag.bag, role, name, kind, *map(float, values)]
                is_shown = name == 'sdp' and kind != 'measured filtered'
                (shown if is_shown or (name, kind) == ('cad', 'filtered') else rows).append(row)
    for each in (shown, rows):
        each.sort(key=lambda row: (str(row[1]), str(row[0])))
    headings = ['bag', 'part', 'solver', 'torque', *names]
    best = [index for index, row in enumerate(shown) if row[2:4] == ['sdp', 'filtered']]
    others = folded('Other solvers and kinds of error', table(headings, rows))
    return Html(table(headings, shown, best) + others)


def parameter_table(result: IdentificationResult, truth: Truth | None) -> Html:
    """Return table A.1 of the thesis: every parameter, compared with the CAD value."""
    estimate = result.recommended.estimate
    cad, ols = (result.solutions[name].estimate.theta for name in ('cad', 'ols'))
    units = list(_RIGID_UNITS) * result.robot.n
    units += [term.unit.replace('^2', '²') for _, term in estimate.model.joint_columns]
    headings = ['parameter', 'unit', 'CAD', 'ols', 'sdp', 'standard deviation', 'from data [%]']
    if truth:
        headings.append('true')
        true = np.where(truth.names(estimate.model), truth.vector(estimate.model), np.nan)
    std = estimate.std if estimate.std is not None else np.full(len(cad), np.nan)
    known = estimate.determined if estimate.determined is not None else np.full(len(cad), np.nan)
    in_sums = result.only_in_sums
    rows = []
    for i, name in enumerate(estimate.model.columns):
        row: list[object] = [name, Html(units[i]), float(cad[i]), float(ols[i])]
        source = number(100.0 * float(known[i]), 3)
        if name in in_sums:
            source += ', in a sum'
        row += [float(estimate.theta[i]), float(std[i]), Html(source)]
        if truth:
            row.append(float(true[i]))
        rows.append(row)
    return table(headings, rows)


def base_parameter_table(result: IdentificationResult) -> Html:
    """Return the table of base parameters that the data determine."""
    base = result.used_base
    solvers = ('cad', 'ols', 'sdp')
    values = [base.values(result.solutions[name].estimate.theta) for name in solvers]
    std = result.base_deviations
    excitation = result.base_prior_deviations / np.maximum(std, 1e-300)
    columns = np.column_stack([*values, std, excitation]).tolist()
    rows = [[name, *row] for name, row in zip(base.expressions(), columns, strict=True)]
    headings = ['base parameter', 'CAD', 'ols', 'sdp', 'standard deviation', 'excitation']
    return table(headings, rows)


def conditioning_tables(result: IdentificationResult) -> Html:
    """Return tables of the motion and of the filters of the conditioning."""
    conditioner = result.conditioner
    period = 'not periodic'
    if conditioner.fundamental is not None:
        period = f'f0 = {conditioner.fundamental:.4g} Hz, {conditioner.harmonics} harmonics'
    facts: list[list[object]] = [
        ['samples', str(result.samples)],
        ['period', period],
        ['motion is below', f'{conditioner.band:.3g} Hz'],
        ['torque low-pass', f'{conditioner.cutoff:.3g} Hz, zero phase'],
        ['kinematics', result.filter_choice.kinematics.label],
        ['gravity', _gravity(result)],
        ['delays', _delays(result)],
    ]
    for name, base in (('thesis', result.thesis_base), ('used', result.used_base)):
        text = f'{len(base.columns)} columns, rank {base.rank}, '
        facts.append([f'regressor, {name}', text + f'condition number {base.condition_number:.4g}'])
    choice = result.filter_choice
    trials = [[f'{k.cutoff:.3g}', k.label, error] for k, error in choice.trials.items()]
    chosen = [i for i, k in enumerate(choice.trials) if k == choice.kinematics]
    headings = [
        'tried cutoff [Hz]',
        'filter of positions, velocities and accelerations',
        'held-out raw error [%]',
    ]
    return Html(table(['conditioning', ''], facts) + table(headings, trials, chosen))


def recording_table(facts: Mapping[str, BagFacts]) -> Html:
    """Return the table of the used part and the recording losses of each bag."""
    if not facts:
        return Html('')
    rows = [
        [name, known.used, *(_count(x) for x in (known.lost, known.missed_cycles))]
        for name, known in facts.items()
    ]
    return table(['bag', 'used', 'states lost', 'cycles missed'], rows)


def _count(value: int | None) -> Html:
    return Html('not recorded' if value is None else str(value))


def _gravity(result: IdentificationResult) -> str:
    found = result.gravity
    if found.error is None:
        return 'as stated'
    share = (
        'squared error on held-out parts, relative to the stated gravity: '
        f'{100.0 * found.error:.0f} %'
    )
    if found.tilt == 0.0:
        return f'as stated ({share})'
    return f'tilted by {np.degrees(found.tilt):.2f}° from the stated gravity ({share})'


def _delays(result: IdentificationResult) -> str:
    names, used = result.robot.joint_names, result.conditioner.delays
    late = {
        'velocities': [
            f'{n} {1e3 * v:.1f} ms' for n, v in zip(names, used.velocity, strict=True) if v
        ],
        'efforts': [
            f'{n} {1e3 * v:.1f} ± {1e3 * d:.1f} ms'
            for n, v, d in zip(names, used.effort, result.delay.deviation, strict=True)
            if v
        ],
    }
    parts = (f'{word} are late: {", ".join(texts)}' for word, texts in late.items() if texts)
    return '; '.join(parts) or 'none'


def payload_table(payload: Payload) -> Html:
    """Return the table of the last link's payload, with standard deviations."""
    centre = zip('xyz', payload.centre, payload.centre_std, strict=True)
    rows: list[list[object]] = [
        [f'centre of mass {axis}', Html('m'), float(value), float(std)]
        for axis, value, std in centre
    ]
    entries = zip(PARAMETER_NAMES, _RIGID_UNITS, payload.inertial, payload.std, strict=True)
    rows += [[name, Html(unit), float(value), float(std)] for name, unit, value, std in entries]
    return table([f'carried by {payload.link}', 'unit', 'value', 'standard deviation'], rows)


def excitation_table(result: IdentificationResult) -> Html:
    """Return the table of each bag's motion range and excitation, per joint."""
    headings = ['bag', 'joint', 'beyond the identification range: q [%]', 'dq [%]', 'ddq [%]']
    headings += ['uncertainty of predicted torque [Nm]', 'noise [Nm]']
    rows: list[list[object]] = []
    for demand in result.demands:
        for joint, name in enumerate(result.robot.joint_names):
            row: list[object] = [demand.bag, name, *map(float, 100.0 * demand.beyond[:, joint])]
            row += [float(demand.uncertainty[joint]), float(result.fit.noise.std[joint])]
            rows.append(row)
    return table(headings, rows)


def friction_table(result: IdentificationResult) -> Html:
    """Return the table of each joint's friction model."""
    names, model = result.robot.joint_names, result.fit.model
    return table(
        ['joint', 'terms other than links'],
        [
            [name, ', '.join(term_text(term, names) for term in t)]
            for name, t in zip(names, model.terms, strict=True)
        ],
    )


def truth_table(errors: Sequence[InertialTorqueError], joints: Sequence[str]) -> Html:
    """Return the table of link and rotor torque errors relative to the true parameters."""
    headings = ['bag', 'solver', 'inertial torque error [%]']
    headings += [f'{joint} [%]' for joint in joints] + ['against true torque constants [%]']
    rows = [[e.bag, e.solver, e.total, *map(float, e.per_joint), e.total_absolute] for e in errors]
    return table(headings, rows, [i for i, e in enumerate(errors) if e.solver == 'sdp'])
