"""Whether a result is as good as it has to be, for a program that can't read a report."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_error import ConfigError
from aerarm_ros.description.plain_yaml import read_plain
from aerarm_ros.identification.assessment.assessment import BagAssessment
from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.recording.identification_error import IdentificationError


@dataclass(frozen=True)
class Check:
    """One limit, and what was found.

    Attributes
    ----------
    name : str
        A key of `LIMITS`.
    limit, value : float
    passed : bool
    """

    name: str
    limit: float
    value: float
    passed: bool


@dataclass(frozen=True)
class Verdict:
    """All limits that were asked for."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every limit is kept."""
        return all(check.passed for check in self.checks)

    @property
    def text(self) -> str:
        """One line a limit, for a terminal."""
        return '\n'.join(
            f'{"kept  " if check.passed else "FAILED"}  {check.name}: {check.value:.4g}, at most '
            f'{check.limit:.4g}'
            for check in self.checks
        )


def _bags(result: IdentificationResult) -> list[BagAssessment]:
    """Return what was only predicted; what was identified from where there is nothing else."""
    return result.recommended.validation or result.recommended.identification


def _largest(
    values: Callable[[BagAssessment], npt.ArrayLike],
) -> Callable[[IdentificationResult], float]:
    return lambda result: float(
        np.nanmax([np.nanmax(np.asarray(values(bag))) for bag in _bags(result)])
    )


LIMITS: dict[str, Callable[[IdentificationResult], float]] = {
    'filtered': _largest(lambda bag: bag.filtered),
    'filtered_measured': _largest(lambda bag: bag.filtered_measured),
    'raw': _largest(lambda bag: bag.raw),
    'joint_filtered': _largest(lambda bag: bag.per_joint_filtered),
    'joint_raw': _largest(lambda bag: bag.per_joint_raw),
    'torque_deviation': lambda result: max(float(d.uncertainty.max()) for d in result.demands),
    'condition_number': lambda result: result.thesis_base.condition_number,
    'inconsistent': lambda result: float(not result.recommended.estimate.physically_consistent),
    'tilt': lambda result: float(np.degrees(result.gravity.tilt)) if result.gravity else 0.0,
    'warnings': lambda result: float(len(result.warnings)),
}
"""What can be limited: largest errors of the validation bags [%], the standard deviation of
predicted torque because of the parameters' [Nm], (5.2), 0 or 1, degrees, and a count."""


def read_limits(path: Path) -> dict[str, float]:
    """Return the limits in a YAML file.

    Raises
    ------
    IdentificationError
        If it can't be read, or holds something else than keys of `LIMITS` with numbers.
    """
    try:
        document = read_plain(path)
    except OSError as error:
        raise IdentificationError(f'{path}: {error.strerror or error}: check the path') from None
    except ConfigError as error:
        raise IdentificationError(f'{path}: {" ".join(str(error).split())}') from None
    known = f'limits are {", ".join(LIMITS)}'
    if not isinstance(document, dict) or not document:
        raise IdentificationError(f'{path}: no limits: {known}')
    unknown = [str(key) for key in document if key not in LIMITS]
    if unknown:
        raise IdentificationError(f'{path}: no limit {", ".join(unknown)}: {known}')
    for key, value in document.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not np.isfinite(value) or value < 0.0:
            raise IdentificationError(f'{path}: {key} = {value} must be a number not below 0')
    return {key: float(value) for key, value in document.items()}


def judge(result: IdentificationResult, limits: dict[str, float]) -> Verdict:
    """Compare a result with limits.

    Parameters
    ----------
    result : IdentificationResult
    limits : dict
        Keys of `LIMITS` to the largest value that is good enough.
    """
    checks = []
    for name, limit in limits.items():
        value = LIMITS[name](result)
        checks.append(Check(name, limit, value, value <= limit))
    return Verdict(tuple(checks))
