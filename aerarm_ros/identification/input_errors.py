"""Detection of common errors in recordings, and warnings about implausible results.

Errors are detected by a fit to corrected data. Examples are a wrong sign, swapped names, a shifted
zero or a wrong torque constant of one joint, and gravity along another axis. Once such an error is
corrected, a model near the nominal one explains the torque much better. Each possible error is
therefore corrected in turn, a simple model is fitted, and the costs are compared.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identification_result import BagAssessment, Solution
from aerarm_ros.identification.joint_model import COUPLED, ArmParameters, JointTerm, TermKind
from aerarm_ros.identification.model_fit import LINK_SPREAD, ModelFit
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import MASS_FACTOR, Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array

_ROWS = 300  # number of samples used
_NOISE = 0.03  # smallest assumed residual of a simple model, relative to the torque
_CORRELATION = 20.0  # number of neighbouring samples that together count as one independent sample
_QUARTER = np.pi / 2.0
_ZEROS = (_QUARTER, -_QUARTER, np.pi)
_TERMS = 4  # number of terms of each joint: viscous, Coulomb, rotor, offset
_NOT_NEGATIVE = 3  # the first three terms cannot be negative
_SUSPICIOUS = 1.5  # largest cost per independent sample of correct input, which is about 1
_CLEARLY = 0.6  # largest cost with the correction, relative to the cost without it
_GOOD = 15.0  # [%] largest torque residual after correction
# smallest relative deviation of a torque factor; smaller ones may result from gear losses
_OTHER_CONSTANT = 0.25
# smallest fraction of the frictionless torque that must be explained, for a valid factor
_EXPLAINED = 0.5
_LEAST_FACTOR, _MOST_FACTOR = 1e-6, 1e6


@dataclass(frozen=True, eq=False)
class _Motion:
    """Selected samples of all bags: (M, n) positions, velocities, accelerations and torques."""

    q: Array
    dq: Array
    ddq: Array
    tau: Array

    @property
    def n(self) -> int:
        return int(self.q.shape[1])

    def swapped(self, one: int, other: int) -> '_Motion':
        order = np.arange(self.n)
        order[[one, other]] = other, one
        return _Motion(*(values[:, order] for values in (self.q, self.dq, self.ddq, self.tau)))

    def shifted(self, joint: int, angle: float) -> '_Motion':
        q = self.q.copy()
        q[:, joint] -= angle
        return replace(self, q=q)

    def scaled(self, joint: int, factor: float) -> '_Motion':
        tau = self.tau.copy()
        tau[:, joint] *= factor
        return replace(self, tau=tau)


class _Fit(NamedTuple):
    """Quality of the fit of a simple torque model.

    `cost` is the sum of squared torque residuals and parameter deviations in standard deviations;
    `error` is the relative torque residual [%].
    """

    cost: float
    error: float


def find_input_errors(robot: Robot, bags: Sequence[SampleColumns], cad: ArmParameters) -> list[str]:
    """Return a warning about the input error whose correction clearly improves the fit; else [].

    Parameters
    ----------
    robot : Robot
        Robot with the stated gravity.
    bags : sequence of SampleColumns
        Identification bags.
    """
    motion = _thinned(bags)
    model = _SimpleModel(robot, cad)
    rigid = model.rigid(motion)
    plain = model.fit(motion, rigid)
    if plain.cost < _SUSPICIOUS * motion.q.size / _CORRELATION:
        return []
    trials = _trials(model, motion, rigid)
    tried = [(model.fit(changed, columns), text) for changed, columns, text in trials]
    best, text = min(tried, key=lambda pair: pair[0].cost, default=(plain, ''))
    if best.cost > _CLEARLY * plain.cost or best.error > max(_GOOD, 0.5 * plain.error):
        return []
    return [
        f'{text} (with this correction a simple model leaves {best.error:.2g} % of the torque '
        f'unexplained, without it {plain.error:.2g} %)'
    ]


def _chosen(bags: Sequence[SampleColumns]) -> npt.NDArray[np.intp]:
    measured = np.concatenate([bag.samples.measured.all(axis=1) for bag in bags])
    if not measured.any():
        measured = np.concatenate([bag.samples.kept for bag in bags])
    (rows,) = np.nonzero(measured)
    return rows[np.linspace(0, len(rows) - 1, min(_ROWS, len(rows))).astype(np.intp)]


def _thinned(bags: Sequence[SampleColumns]) -> _Motion:
    rows = _chosen(bags)
    samples = [bag.samples for bag in bags]
    parts = zip(*((s.q, s.dq, s.ddq, s.tau) for s in samples), strict=True)
    return _Motion(*(np.vstack(part)[rows] for part in parts))


def _joint_columns(motion: _Motion, joint: int) -> Array:
    dq, ddq = motion.dq[:, joint], motion.ddq[:, joint]
    return np.column_stack([dq, np.sign(dq), ddq, np.ones_like(dq)])


def _factor(motion: _Motion, joint: int, expected: Array) -> tuple[float, float]:
    """Return the factor from expected to measured torque, and the explained fraction of torque."""
    others = _joint_columns(motion, joint)
    torques = np.column_stack([expected, motion.tau[:, joint]])
    left, measured = (torques - others @ np.linalg.lstsq(others, torques, rcond=None)[0]).T
    size = float(left @ left)
    if size <= (1e-3 * float(np.linalg.norm(expected))) ** 2:
        return 1.0, 0.0
    factor = float(left @ measured) / size
    rest = measured - factor * left
    return factor, 1.0 - float(rest @ rest) / max(float(measured @ measured), 1e-300)


class _SimpleModel:
    """Simple torque model: links near nominal parameters, friction, rotors and offsets."""

    def __init__(self, robot: Robot, cad: ArmParameters) -> None:
        self.joints = robot.joint_names
        self._regressor = Regressor(robot)
        self._mean = cad.inertial.ravel()
        self._spread = LINK_SPREAD * cad.inertial_scale().ravel()

    def rigid(self, motion: _Motion, gravity: Array | None = None) -> Array:
        """Return the regressor of the links (M, n, 10 n), optionally with other gravity."""
        regressor = self._regressor
        if gravity is not None:
            regressor = Regressor(regressor.robot.with_gravity(gravity))
        return regressor.stack_rigid(motion.q, motion.dq, motion.ddq)

    def other_gravities(self) -> list[Array]:
        """Return gravity vectors along all other axis directions of the base frame."""
        stated = np.array(self._regressor.robot.gravity_in_base)
        size = float(np.linalg.norm(stated))
        axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        return [size * axis for axis in axes if axis @ stated < 0.9 * size]

    def links(self, motion: _Motion, rigid: Array, rows: Sequence[int]) -> Array:
        """Return the links' parameters (10 n,) from a fit to the torques of selected joints."""
        return self._solved(motion, rigid, rows)[0][: len(self._mean)]

    def fit(self, motion: _Motion, rigid: Array) -> _Fit:
        """Return the cost and the relative torque residual of a simple fit."""
        theta, misfit, left = self._solved(motion, rigid, range(motion.n))
        distance = ((theta[: len(self._mean)] - self._mean) / self._spread) ** 2
        return _Fit(
            misfit + float(distance.sum()),
            100.0 * left / max(float(np.linalg.norm(motion.tau)), 1e-300),
        )

    def _solved(
        self, motion: _Motion, rigid: Array, rows: Sequence[int]
    ) -> tuple[Array, float, float]:
        """Return parameters, squared residual over squared noise, and norm of the residual [Nm]."""
        links, n = len(self._mean), motion.n
        size = links + _TERMS * n
        gram, right = np.zeros((size, size)), np.zeros(size)
        blocks = []
        for joint in rows:
            torque = motion.tau[:, joint]
            columns = np.zeros((len(torque), size))
            columns[:, :links] = rigid[:, joint]
            own = links + _TERMS * joint
            columns[:, own : own + _TERMS] = _joint_columns(motion, joint)
            unit = np.sqrt(_CORRELATION / len(torque)) * _floor(rigid[:, joint], motion, joint)
            wanted = torque - columns[:, :links] @ self._mean
            gram += columns.T @ columns / unit**2
            right += columns.T @ wanted / unit**2
            blocks.append((columns, wanted, unit))
        spread = np.concatenate([self._spread, np.full(_TERMS * n, np.inf)])
        change = _not_negative(gram, right, spread, links)
        rests = [wanted - columns @ change for columns, wanted, _ in blocks]
        squares = [float(rest @ rest) for rest in rests]
        misfit = sum(s / unit**2 for s, (*_, unit) in zip(squares, blocks, strict=True))
        change[:links] += self._mean
        return change, misfit, float(np.sqrt(sum(squares)))


def _floor(rigid: Array, motion: _Motion, joint: int) -> float:
    """Return a joint's torque residual (norm [Nm]) after a fit without bounds and prior."""
    torque = motion.tau[:, joint]
    columns = np.column_stack([rigid, _joint_columns(motion, joint)])
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-9)
    # Normal equations are several times faster than lstsq and accurate enough for a noise level.
    gram = columns.T @ columns + 1e-9 * np.eye(columns.shape[1])
    left = torque - columns @ np.linalg.solve(gram, columns.T @ torque)
    return max(float(np.linalg.norm(left)), _NOISE * float(np.linalg.norm(torque)), 1e-9)


def _not_negative(gram: Array, right: Array, spread: Array, links: int) -> Array:
    """Return the solution in which negative friction and rotor inertia are replaced by 0."""
    size = len(right)
    scale = np.sqrt(np.diag(gram) + 1.0 / spread**2)
    scale[scale <= 0.0] = 1.0
    system = (gram + np.diag(1.0 / spread**2)) / np.outer(scale, scale) + 1e-10 * np.eye(size)
    bounded = np.zeros(size, dtype=bool)
    bounded[links:] = np.arange(size - links) % _TERMS < _NOT_NEGATIVE
    free = np.ones(size, dtype=bool)
    while True:
        found = np.zeros(size)
        found[free] = np.linalg.solve(system[np.ix_(free, free)], (right / scale)[free])
        negative = free & bounded & (found < 0.0)
        if not negative.any():
            return found / scale
        free &= ~negative


def _trials(
    model: _SimpleModel, motion: _Motion, rigid: Array
) -> Iterator[tuple[_Motion, Array, str]]:
    """Yield corrected data, link columns and an error text for each possible input error."""
    joints = model.joints
    for joint, name in enumerate(joints):
        others = [other for other in range(motion.n) if other != joint]
        expected = rigid[:, joint] @ model.links(motion, rigid, others)
        factor, _ = _factor(motion, joint, expected)
        text = (
            f'the effort of {name} has the opposite sign: check the direction of its motor, or '
            f'pass --effort-gain {name}=-1'
        )
        yield motion.scaled(joint, -1.0), rigid, text
        wrong = abs(factor - 1.0) > _OTHER_CONSTANT and _LEAST_FACTOR < factor < _MOST_FACTOR
        if wrong:
            text = (
                f'the effort of {name} is {factor:.2g} times the value that follows from the '
                'torque of the other joints: check its torque constant, gear ratio and unit, or '
                f'pass --effort-gain {name}={1.0 / factor:.3g}'
            )
            yield motion.scaled(joint, 1.0 / factor), rigid, text
    for one, other in combinations(range(motion.n), 2):
        swapped = motion.swapped(one, other)
        first, second = joints[one], joints[other]
        text = (
            f'the names of {first} and {second} are swapped: check the order of the joints, or '
            f'pass --rename {first}={second} {second}={first}'
        )
        yield swapped, model.rigid(swapped), text
    for joint, name in enumerate(joints):
        for angle in _ZEROS:
            shifted = motion.shifted(joint, angle)
            text = (
                f'the zero position of {name} is off by {np.degrees(angle):+.0f} degrees: check '
                'the zero of its encoder, and whether the URDF belongs to that arm'
            )
            yield shifted, model.rigid(shifted), text
    for gravity in model.other_gravities():
        along = ' '.join(f'{value:.3g}' for value in gravity + 0.0)
        text = (
            'the direction of gravity differs from the stated direction: check how the base is '
            f'mounted, or pass --gravity {along}'
        )
        yield motion, model.rigid(motion, gravity), text


# Torque error [%] above which the CAD model contradicts the input. A prediction of zero torque
# has the error 100 %; efforts in a much smaller unit give almost 100 %.
_USELESS = 90.0
# The semidefinite program normally increases the least torque error by a few per cent only.
_FAR_ABOVE = 3.0
_LARGE = 10.0  # [%]
_OTHER_UNIT = 5.0  # largest plausible ratio of measured and modelled torque
_AT_BOUND = 0.01  # relative distance from its bound, below which a mass counts as at the bound
_CLEARLY_NEGATIVE = 3.0  # standard deviations

# [%] torque error of a joint above which a warning appears
_FAR_OFF = 20.0
_FOLLOWS = 0.5  # fraction of a joint's residual that the motion of another joint must explain

_CHECK = (
    'check the sign and unit of the effort (--effort-gain), the direction of gravity (--gravity), '
    'the topic, and the joint names (--rename)'
)


def error_warnings(
    solutions: Mapping[str, Solution],
    bags: list[SampleColumns],
    cad: ArmParameters,
    joints: tuple[str, ...],
) -> list[str]:
    """Return warnings about probably wrong input, from the torque errors of the solvers.

    Parameters
    ----------
    solutions : mapping
        Solutions by solver, including those of `solvers.ALWAYS`.
    bags : list of SampleColumns
        Identification bags.
    """
    drawn, ols, sdp = (
        float(np.mean([bag.filtered for bag in solutions[name].identification]))
        for name in ('cad_friction', 'ols', 'sdp')
    )
    warnings = []
    if drawn > _USELESS:
        suspects = _suspects(bags, cad, joints)
        hint = f' ({"; ".join(suspects)})' if suspects else ''
        warnings.append(
            'the CAD model with identified friction differs from the measured torque by '
            f'{drawn:.0f} %{hint}: {_CHECK}'
        )
    if sdp > max(_LARGE, _FAR_ABOVE * ols):
        warnings.append(
            f'a physically consistent model leaves {sdp:.1f} % of the torque unexplained, but '
            f'unconstrained least squares only {ols:.1f} %, so an input must be wrong: {_CHECK}'
        )
    return warnings


def joint_warnings(recommended: Solution, joints: tuple[str, ...]) -> list[str]:
    """Return warnings about joints with a large torque error."""
    fitted, predicted = (
        _joint_errors(part, len(joints))
        for part in (recommended.identification, recommended.validation)
    )
    poor = fitted > _FAR_OFF
    warnings = []
    for errors, shown, where, advice in (
        (
            fitted,
            poor,
            '',
            'do not rely on their friction and on parameters that only they identify',
        ),
        (predicted, (predicted > _FAR_OFF) & ~poor, ' in validation', 'compare both motions'),
    ):
        named = zip(joints, errors, shown, strict=True)
        texts = ', '.join(f'{name} {error:.0f} %' for name, error, is_shown in named if is_shown)
        if texts:
            limit = f'exceeds {_FAR_OFF:.0f} %{where}'
            warnings.append(f'the torque error of some joints {limit} ({texts}): {advice}')
    return warnings


def coupling_warnings(
    recommended: Solution, bags: list[SampleColumns], joints: tuple[str, ...]
) -> list[str]:
    """Return warnings about joints whose residual follows another joint's motion.

    Parameters
    ----------
    bags : list of SampleColumns
        Identification bags.
    """
    warnings = []
    errors = _joint_errors(recommended.identification, len(joints))
    for joint in np.flatnonzero(errors > _LARGE).tolist():
        share, driver = max(_followed(recommended, bags, joint), default=(0.0, 0))
        if share > _FOLLOWS:
            pair = f'{joints[joint]}={joints[driver]}'
            warnings.append(
                f'the velocity or acceleration of {joints[driver]} explains {100.0 * share:.0f} % '
                f'of the torque residual of {joints[joint]}: if the drive of one joint passes '
                f'through the other, pass --coupled {pair}'
            )
    return warnings


def _joint_errors(bags: list[BagAssessment], n: int) -> Array:
    """Return the largest torque error of each joint over all bags [%]; 0 without bags."""
    return np.asarray(np.fmax.reduce([np.zeros(n), *(bag.per_joint_filtered for bag in bags)]))


def _followed(
    recommended: Solution, bags: list[SampleColumns], joint: int
) -> Iterator[tuple[float, int]]:
    """Yield the fraction of a joint's residual that each other joint's motion explains."""
    rows = [bag.samples.usable[:, joint] for bag in bags]
    pairs = list(zip(bags, recommended.identification, rows, strict=True))
    residual = np.concatenate(
        [(b.samples.tau - a.prediction.filtered)[row, joint] for b, a, row in pairs]
    )
    known = recommended.estimate.model.terms[joint]
    for other in range(bags[0].samples.n):
        terms = [JointTerm(kind, driver=other) for kind in COUPLED]
        if other == joint or terms[0] in known or not len(residual):
            continue
        columns = np.concatenate(
            [np.column_stack([b.term(term)[row, 0] for term in terms]) for b, _, row in pairs]
        )
        solved, *_ = np.linalg.lstsq(columns, residual, rcond=None)
        left = residual - columns @ solved
        yield 1.0 - float(left @ left) / max(float(residual @ residual), 1e-300), other


def bound_warnings(estimate: Estimate, fit: ModelFit, cad_mass: Array) -> list[str]:
    """Return warnings about parameters of the recommended estimate at their bounds.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the semidefinite program.
    fit : ModelFit
        Fit with the unconstrained solution in `theta`.
    cad_mass : (n,) ndarray
        Nominal masses [kg].
    """
    warnings = []
    ratio = estimate.inertial[:, 0] / cad_mass
    for bound, word in ((1.0 / MASS_FACTOR, 'half'), (MASS_FACTOR, 'twice')):
        at = np.abs(ratio / bound - 1.0) < _AT_BOUND
        if at.any():
            links = [name for name, held in zip(fit.model.link_names, at, strict=True) if held]
            warnings.append(
                f'the estimated mass of {", ".join(links)} is at its bound, {word} the mass in the '
                'URDF: check the masses in the URDF and the unit of the effort'
            )
    start = 10 * fit.model.n
    loads = [term.kind is TermKind.LOAD for _, term in fit.model.joint_columns]
    too_much = np.array(loads, dtype=bool) & (estimate.theta[start:] > 1.0 - _AT_BOUND)
    if too_much.any():
        at_bound = np.array(fit.model.columns[start:])[too_much]
        warnings.append(
            f'the load-dependent friction {", ".join(at_bound)} is at its upper bound 1, at which '
            'the gear loses all transmitted torque: look for another load-dependent torque at '
            'these joints'
        )
    std = fit.prior.std if estimate.std is None else estimate.std
    clearly_negative = estimate.held_at_zero & (fit.theta < -_CLEARLY_NEGATIVE * std)
    held = np.flatnonzero(clearly_negative[start:])
    if len(held):
        kinds = {fit.model.joint_columns[index][1].kind for index in held}
        if TermKind.COULOMB in kinds:
            check = 'check the sign of the effort of these joints'
        elif kinds == {TermKind.ROTOR}:
            check = (
                'negative rotor inertia is normal for torque sensors behind the gears; otherwise '
                'the velocities may be delayed, or the model of these joints is inexact'
            )
        else:
            check = (
                'the model of these joints is inexact, or their measured velocities are delayed; '
                'check the errors per joint'
            )
        names = ', '.join(fit.model.columns[start + index] for index in held)
        warnings.append(
            f'the terms {names} are omitted, because their values are negative in a fit without '
            f'bounds: {check}'
        )
    return warnings


def _suspects(bags: list[SampleColumns], cad: ArmParameters, joints: tuple[str, ...]) -> list[str]:
    """Return texts about joints whose measured and modelled torque differ in sign or magnitude.

    Joints with little load are excluded, because their torque is mainly friction, which the nominal
    model lacks.
    """
    found = []
    motion = _thinned(bags)
    drawn = np.vstack([bag.links_torque(cad.inertial.ravel()) for bag in bags])[_chosen(bags)]
    for joint, name in enumerate(joints):
        factor, share = _factor(motion, joint, drawn[:, joint])
        if share <= _EXPLAINED:
            continue
        if factor < 0.0:
            found.append(f'the effort of {name} has the opposite sign')
        elif not 1.0 / _OTHER_UNIT < factor < _OTHER_UNIT:
            found.append(f'the effort of {name} is {factor:.2g} times the modelled torque')
    return found
