"""The outcome of an identification, as a program or a notebook has use for it."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.assessment.assessment import BagAssessment
from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.files.summary import summarise
from aerarm_ros.identification.report.report import ReportExtras
from aerarm_ros.identification.report.report_tables import error_table, parameter_table
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.pages.html_text import bullets, paragraph
from aerarm_ros.ros.programs.identifier_files import RESULT_FILES, write_result
from aerarm_ros.ros.programs.identifier_table import terminal_table

Array = npt.NDArray[np.float64]


class IdentifiedArm:
    """An arm as identified: its parameters, and how well they predict torque.

    Parameters
    ----------
    result : IdentificationResult
        All that is known, for those who want more than is offered here.
    seconds : dict of str to float
        How long each stage took [s].
    """

    def __init__(self, result: IdentificationResult, seconds: dict[str, float]) -> None:
        self.result = result
        self._seconds = seconds

    @property
    def estimate(self) -> Estimate:
        """Physically consistent parameters, with standard deviations."""
        return self.result.recommended.estimate

    @property
    def robot(self) -> Robot:
        """The arm with the identified links, under gravity as it was found."""
        return self.result.robot.with_inertial_parameters(self.estimate.inertial)

    @property
    def parameters(self) -> dict[str, float]:
        """Every parameter by its name, as `m_link1` or `fv_joint2`, in SI units."""
        names = self.estimate.model.columns
        return dict(zip(names, self.estimate.theta.tolist(), strict=True))

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> Array:
        """Return the torque of the whole model, thesis (3.5): links, rotors, friction.

        Parameters
        ----------
        q, dq, ddq : (n,) or (M, n) array_like
            [rad], [rad/s], [rad/s^2]

        Returns
        -------
        (n,) or (M, n) ndarray
            [Nm]

        Raises
        ------
        ValueError
            If the shapes differ, or are not those of this arm.
        """
        motion = [np.asarray(values, dtype=float) for values in (q, dq, ddq)]
        shape = motion[0].shape
        n = self.result.robot.n
        is_known = shape[-1:] == (n,) and len(shape) <= 2
        if not is_known or any(values.shape != shape for values in motion):
            shapes = ', '.join(str(values.shape) for values in motion)
            raise ValueError(f'q, dq and ddq have the shapes {shapes}: give ({n},) or (M, {n})')
        rows = [values.reshape(-1, n) for values in motion]
        inertial = self.estimate.inertial.ravel()
        links = Regressor(self.robot).stack_rigid(*rows) @ inertial
        torque = self.estimate.model.torque(self.estimate.theta, links, rows[1], rows[2])
        return torque.reshape(shape)

    @property
    def errors(self) -> list[BagAssessment]:
        """Torque errors on validation, or, where there was none, on identification."""
        recommended = self.result.recommended
        return recommended.validation or recommended.identification

    @property
    def warnings(self) -> list[str]:
        """What to know before trusting it, and what to check."""
        return list(self.result.warnings)

    def summary(self) -> str:
        """Return the torque errors of each solver on each bag, and warnings, as text."""
        lines = [terminal_table(self.result, {})]
        return '\n'.join(lines + [f'- {text}' for text in self.warnings])

    def as_dict(self) -> dict[str, object]:
        """Return the figures of `summary.json`."""
        return summarise(self.result, self._seconds)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write what the identifier writes: YAML, URDF, MJCF, SDF, summary.json and report.html.

        Parameters
        ----------
        folder : path
            May be missing, empty, or an earlier result, which is replaced.

        Raises
        ------
        IdentificationError
            If it can't be written, or holds something else.
        """
        with ResultDirectory(Path(folder), 'save(folder)', RESULT_FILES) as directory:
            write_result(self.result, directory, ReportExtras())
            directory.write_json(MARKER, self.as_dict())
        return directory.target

    def __repr__(self) -> str:
        """Return the figure that matters."""
        worst = max(self.errors, key=lambda bag: bag.filtered)
        return (
            f'<IdentifiedArm {self.result.robot.model.name}: torque error {worst.filtered:.2f} % '
            f'filtered, {worst.filtered_measured:.2f} % only the measured one, {worst.raw:.2f} % '
            f'raw on {worst.bag}>'
        )

    def _repr_html_(self) -> str:
        """Return tables for a notebook."""
        parts = [error_table(self.result)]
        if self.warnings:
            parts.append(bullets(self.warnings, 'warnings'))
        parts += [paragraph(f'{self.result.samples} samples'), parameter_table(self.result, None)]
        return ''.join(parts)
