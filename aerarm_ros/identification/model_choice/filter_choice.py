"""Choosing the cut-off, and how to clean the kinematics, by recorded torque that is held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.model_choice.effort_delay import EffortDelay
from aerarm_ros.identification.model_choice.simple_fit import SimpleFit
from aerarm_ros.identification.model_choice.standard_errors import block_sums, standard_errors
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.model.regressor import Regressor

Array = npt.NDArray[np.float64]

_BY_CHANCE = 2.0  # standard errors by which the best of several trials may seem better
_ENOUGH = 60.0  # [s] of a long recording, from its middle, decide


@dataclass(frozen=True)
class FilterTrial:
    """A filter that was tried.

    Attributes
    ----------
    cutoff : float
        Of the torque's low-pass [Hz].
    kinematics : KinematicsFilter
    error : float
        Torque error [%] on parts of the motion that were left out of the fit, as recorded.
    """

    cutoff: float
    kinematics: KinematicsFilter
    error: float


@dataclass(frozen=True, eq=False)
class FilterChoice:
    """What was tried, and the samples of the best.

    Attributes
    ----------
    trials : list of FilterTrial
    conditioner : Conditioner
        At the chosen cut-off.
    kinematics : KinematicsFilter
        The one chosen.
    bags : list of SampleColumns
        The recordings, filtered by it.
    """

    trials: list[FilterTrial]
    conditioner: Conditioner
    kinematics: KinematicsFilter
    bags: list[SampleColumns]

    def excerpts(
        self, regressor: Regressor, recordings: Sequence[Recording], in_time: bool = False
    ) -> list[SampleColumns]:
        """Return what is enough of the recordings, filtered alike; all of them if they are short.

        With velocities moved to where positions say, if that is asked for.
        """
        parts = [_excerpt(recording) for recording in recordings]
        if not in_time and all(part is r for part, r in zip(parts, recordings, strict=True)):
            return self.bags
        kinematics = replace(self.kinematics, in_time=in_time or self.kinematics.in_time)
        return [condition_once(regressor, self.conditioner, part, kinematics) for part in parts]

    @property
    def has_late_velocities(self) -> bool:
        """Whether the kinematics come from velocities that are known to be late."""
        kinematics = self.kinematics
        as_measured = not (kinematics.from_position or kinematics.in_time)
        return as_measured and bool(self.conditioner.delays.velocity.any())

    def with_effort_delay(
        self, regressor: Regressor, recordings: Sequence[Recording], delay: EffortDelay
    ) -> 'FilterChoice':
        """Return the same choice for the same recordings, signals moved by what they are late."""
        if not delay.used.any() and not delay.in_time:
            return self
        moved = self.conditioner.with_effort_delay(delay.used)
        kinematics = replace(self.kinematics, in_time=self.kinematics.in_time or delay.in_time)
        bags = [condition_once(regressor, moved, r, kinematics) for r in recordings]
        return replace(self, conditioner=moved, kinematics=kinematics, bags=bags)


def choose_filter(
    regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
) -> FilterChoice:
    """Try the cut-offs, and the ways to clean the kinematics, that the recordings allow.

    Real motion has content beyond the commanded harmonics, such as the ripple of dry friction;
    measured velocities may lag, or be noisy. Which matters more, recorded torque decides, in
    parts of the motion that are left out of the fit: filtered torque would favour whatever filters
    most. Of cut-offs that are equally good, the nearest to the one by rule stays.

    Parameters
    ----------
    regressor : Regressor
    conditioner : Conditioner
    recordings : sequence of Recording
        To identify from.

    Raises
    ------
    IdentificationError
        If a recording is too short.
    """
    trials = _Trials(regressor, conditioner, recordings)
    rule = conditioner.cutoff
    family = trials.best_at(rule)
    trials.walk(conditioner.cutoffs, family)
    cutoff = trials.nearest(rule)
    kinematics = family if cutoff == rule else trials.best_at(cutoff)
    chosen = conditioner.at(cutoff)
    bags = [condition_once(regressor, chosen, r, kinematics) for r in recordings]
    return FilterChoice(trials.tried, chosen, kinematics, bags)


def condition_once(
    regressor: Regressor,
    conditioner: Conditioner,
    recording: Recording,
    kinematics: KinematicsFilter,
    predicted: bool = False,
) -> SampleColumns:
    """Return the columns of a bag that won't be filtered again, with no more memory than needed."""
    conditioner.forget_motions()
    samples = conditioner.condition(recording, kinematics, predicted)
    conditioner.forget_motions()
    return SampleColumns(samples, regressor)


class _Trials:
    """Runs trials, each once, and compares them."""

    def __init__(
        self, regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
    ) -> None:
        self._regressor = regressor
        self._conditioner = conditioner
        self._excerpts = [_excerpt(recording) for recording in recordings]
        self._measured = all(recording.dq is not None for recording in recordings)
        self._cad = ArmParameters.stated(regressor.robot, None)
        self._outcomes: dict[KinematicsFilter, _Outcome] = {}

    def run(self, cutoff: float, like: KinematicsFilter) -> None:
        """Try a cut-off [Hz] with a way to clean the kinematics."""
        conditioner = self._conditioner.at(cutoff)
        kinematics = conditioner.adapted(like)
        if kinematics not in self._outcomes:
            samples = [conditioner.trial(excerpt, kinematics) for excerpt in self._excerpts]
            bags = [SampleColumns(own, self._regressor) for own in samples]
            self._outcomes[kinematics] = _Outcome(
                [own.block for own in samples],
                [own.tau_raw for own in samples],
                SimpleFit(bags, self._cad).raw_residuals(),
            )

    def best_at(self, cutoff: float) -> KinematicsFilter:
        """Try the ways to clean the kinematics at one cut-off, and return the best.

        First filters, with measured velocities if there are any, then the other sources with the
        best of them.
        """
        candidates = self._conditioner.at(cutoff).candidates()
        source = not self._measured
        best = self._best_of(cutoff, [k for k in candidates if k.from_position == source])
        best = self._best_of(cutoff, [best, replace(best, from_position=True)])
        in_time = replace(best, in_time=True, from_position=False)
        if self._measured and self._conditioner.delays.velocity.any():
            self.run(cutoff, in_time)
            errors = self._squared_errors()
            if standard_errors(errors[best] - errors[in_time]) > _BY_CHANCE:
                return in_time
        return best

    def _best_of(self, cutoff: float, candidates: Sequence[KinematicsFilter]) -> KinematicsFilter:
        for kinematics in candidates:
            self.run(cutoff, kinematics)
        errors = self._squared_errors()
        return min(candidates, key=lambda kinematics: float(errors[kinematics].sum()))

    def walk(self, cutoffs: Sequence[float], start: KinematicsFilter) -> None:
        """Try other cut-offs, down and up from that of a filter for as long as errors fall."""
        below = [cutoff for cutoff in reversed(cutoffs) if cutoff < start.cutoff]
        above = [cutoff for cutoff in cutoffs if cutoff > start.cutoff]
        for way in (below, above):
            last = start
            for cutoff in way:
                following = self._conditioner.at(cutoff).adapted(start)
                if self._best_of(cutoff, [last, following]) is last:
                    break
                last = following

    def nearest(self, rule: float) -> float:
        """Return the cut-off nearest to the one by rule among those as good as the best.

        Their difference is within what chance makes of as many trials, judged by how it varies
        over the blocks of the motion.
        """
        errors = self._squared_errors()
        least = min(errors.values(), key=lambda own: float(own.sum()))
        good = [k.cutoff for k, e in errors.items() if standard_errors(e - least) <= _BY_CHANCE]
        return min(good, key=lambda cutoff: abs(np.log(cutoff / rule)))

    @property
    def tried(self) -> list[FilterTrial]:
        """What was tried, and what it left."""
        any_of_them = next(iter(self._outcomes.values()))
        torque = block_sums(any_of_them.blocks, any_of_them.torques, self._common()).sum()
        return [
            FilterTrial(k.cutoff, k, 100.0 * float(np.sqrt(own.sum() / max(torque, 1e-12))))
            for k, own in self._squared_errors().items()
        ]

    def _squared_errors(self) -> dict[KinematicsFilter, Array]:
        """Return the squared error of each block, over the samples that all trials have."""
        common = self._common()
        return {
            kinematics: block_sums(outcome.blocks, outcome.residuals, common)
            for kinematics, outcome in self._outcomes.items()
        }

    def _common(self) -> list[npt.NDArray[np.bool_]]:
        known = [[np.isfinite(own) for own in o.residuals] for o in self._outcomes.values()]
        return [np.logical_and.reduce(of_bag) for of_bag in zip(*known, strict=True)]


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Blocks (M,), torque as recorded (M, n) and what a trial left of it [Nm], of each bag."""

    blocks: list[npt.NDArray[np.intp]]
    torques: list[Array]
    residuals: list[Array]


def _excerpt(recording: Recording) -> Recording:
    if recording.duration <= _ENOUGH:
        return recording
    share = 0.5 * _ENOUGH / recording.duration
    return recording.part(0.5 - share, 0.5 + share, '')
