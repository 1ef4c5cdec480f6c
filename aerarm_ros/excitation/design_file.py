"""Reading and writing of the YAML files of designed trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.config_reader import ConfigError, build, read_yaml, yaml_text
from aerarm_ros.description.resources import write_whole
from aerarm_ros.excitation.feasibility import FeasibilityReport
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory_designer import DesignResult, DesignSpecification


def write_design(path: Path | str, text: str) -> None:
    """Write a text file; on failure, no incomplete file remains.

    Raises
    ------
    ExcitationError
        If the file cannot be written.
    """
    try:
        write_whole(Path(path), text)
    except OSError as error:
        raise ExcitationError(
            f'{path} cannot be written ({error.strerror}): check the folder and its permissions'
        ) from error


FORMAT = 'aerarm_ros/fourier_trajectory/1'


@dataclass(frozen=True)
class _Document:
    """Keys of a trajectory file; the entry `made_with` is only for information."""

    format: str
    fundamental_frequency: float
    joints: dict[str, Any]
    periods: int | None = None
    made_with: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _JointSeries:
    """Fourier coefficients of one joint [rad]."""

    bias: float
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


@dataclass(frozen=True)
class TrajectoryFile:
    """Trajectory with its joint names and its origin.

    Parameters
    ----------
    trajectory : Fourier series of the joints.
    joint_names : name of the joint of each coefficient row.
    made_with : information on how the trajectory was made, for example seed, condition number and
        margins.
    periods : number of periods to play; None if the player decides.
    """

    trajectory: FourierTrajectory
    joint_names: tuple[str, ...]
    made_with: Mapping[str, Any] = field(default_factory=dict)
    periods: int | None = None

    def save(self, path: Path | str) -> None:
        """Write the trajectory file; on failure, an existing file remains unchanged.

        Raises
        ------
        ExcitationError
            If the file cannot be written.
        """
        series = self.trajectory
        joints = {
            name: {
                'bias': float(series.q0[i]),
                'sine': series.alpha[i].tolist(),
                'cosine': series.beta[i].tolist(),
            }
            for i, name in enumerate(self.joint_names)
        }
        document: dict[str, Any] = {'format': FORMAT, 'fundamental_frequency': float(series.f0)}
        if self.periods is not None:
            document['periods'] = self.periods
        document |= {'joints': joints, 'made_with': dict(self.made_with)}
        text = (
            '# Fourier series of each joint, thesis (3.16): bias + sine_k sin(k w0 t) + cosine_k '
            'cos(k w0 t).\n'
            '# Units: Hz, rad. Run `excitation` to play the trajectory.\n'
        ) + yaml_text(document)
        write_design(path, text)

    @classmethod
    def load(cls, path: Path | str) -> TrajectoryFile:
        """Read a trajectory file.

        Raises
        ------
        ExcitationError
            If the file cannot be read or is not a trajectory; the message names file and key.
        """
        path = Path(path)
        try:
            document = build(_Document, 'top level', read_yaml(path))
            return cls._from_document(document)
        except (ConfigError, ExcitationError) as error:
            text = str(error)
            raise ExcitationError(
                text if text.startswith(str(path)) else f'{path}: {text}'
            ) from None

    @classmethod
    def _from_document(cls, document: _Document) -> TrajectoryFile:
        if document.format != FORMAT:
            raise ExcitationError(f'format is {document.format!r} instead of {FORMAT!r}')
        if not isinstance(document.joints, dict) or not document.joints:
            raise ExcitationError('joints must map joint names to bias, sine and cosine')
        if document.periods is not None and document.periods < 1:
            raise ExcitationError(f'periods must be at least 1, not {document.periods}')
        rows = [
            build(_JointSeries, f'joints.{name}', entry) for name, entry in document.joints.items()
        ]
        if len({len(values) for row in rows for values in (row.sine, row.cosine)}) != 1:
            raise ExcitationError('sine and cosine need one value per harmonic in every joint')
        trajectory = FourierTrajectory(
            document.fundamental_frequency,
            np.array([row.bias for row in rows]),
            np.array([row.sine for row in rows]),
            np.array([row.cosine for row in rows]),
        )
        names = tuple(map(str, document.joints))
        return cls(trajectory, names, document.made_with, document.periods)

    def for_joints(self, joint_names: Sequence[str]) -> FourierTrajectory:
        """Return the trajectory, with one row of coefficients per joint in the order `joint_names`.

        Raises
        ------
        ExcitationError
            If the file belongs to other joints.
        """
        if set(joint_names) != set(self.joint_names):
            raise ExcitationError(
                f'the trajectory has joints {", ".join(self.joint_names)}, but the arm has '
                f'{", ".join(joint_names)}: use a trajectory that was designed for this arm'
            )
        rows = [self.joint_names.index(name) for name in joint_names]
        series = self.trajectory
        return FourierTrajectory(series.f0, series.q0[rows], series.alpha[rows], series.beta[rows])


def describe_margins(report: FeasibilityReport) -> dict[str, Any]:
    """Return the smallest margin to each kind of limit, for the file entry `made_with`."""
    return {
        margin.limit: {
            'subject': margin.subject,
            'reached': round(margin.reached, 6),
            'allowed': round(margin.allowed, 6),
            'unit': margin.unit,
        }
        for margin in report.worst_of_each()
    }


def designed_file(
    specification: DesignSpecification, result: DesignResult, periods: int
) -> TrajectoryFile:
    """Return the trajectory file of a design, with `periods` as the number of periods to play."""
    quality = result.quality
    made_with: dict[str, Any] = {
        'seed': specification.seed,
        'start': result.start,
        'condition_number': round(quality.condition_number, 3),
        'scaled_condition_number': round(quality.scaled_condition_number, 3),
        'log_deviation': round(quality.log_deviation, 5),
        'margins': describe_margins(result.report),
        'notes': list(result.report.notes),
    }
    names = specification.setup.limits.joint_names
    return TrajectoryFile(result.trajectory, names, made_with, periods)
