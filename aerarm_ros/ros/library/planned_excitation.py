"""A designed motion, as a program or a notebook has use for it."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.excitation.design.design_result import DesignResult
from aerarm_ros.excitation.design.design_specification import DesignSpecification
from aerarm_ros.excitation.design.designed_file import designed_file
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.pages.html_text import paragraph, table

Array = npt.NDArray[np.float64]


class PlannedExcitation:
    """A feasible Fourier trajectory, and how well it shows the arm's parameters.

    Parameters
    ----------
    specification : DesignSpecification
    result : DesignResult
    periods : int
        To be played.
    """

    def __init__(
        self, specification: DesignSpecification, result: DesignResult, periods: int
    ) -> None:
        self.result = result
        self._specification = specification
        self._periods = periods
        ramp_time = specification.setup.config.ramp_time
        self._motion = RampedExcitation(result.trajectory, periods, ramp_time)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, from base to tool."""
        return self._specification.setup.limits.joint_names

    @property
    def condition_number(self) -> float:
        """Of the regressor along the motion, thesis (5.2)."""
        return self.result.quality.condition_number

    @property
    def duration(self) -> float:
        """Length of the motion from rest to rest [s]."""
        return self._motion.duration

    def sample(self, rate: float = 1000.0) -> tuple[Array, JointReference]:
        """Return the motion from rest to rest as a controller would be given it.

        Parameters
        ----------
        rate : float
            [Hz]

        Returns
        -------
        (M,) ndarray
            Time [s].
        JointReference
            `q`, `dq` and `ddq`, each (M, n).

        Raises
        ------
        ExcitationError
            If the rate is not positive.
        """
        if not (np.isfinite(rate) and rate > 0.0):
            raise ExcitationError(f'rate = {rate:g} must be a positive frequency [Hz]')
        time = np.arange(int(self.duration * rate) + 1) / rate
        return time, self._motion.evaluate(time)

    def summary(self) -> str:
        """Return the figures, and what comes closest to each limit, as text."""
        return f'{self._headline()}\n{self.result.report.as_table()}'

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the trajectory file that `excitation` plays.

        Raises
        ------
        ExcitationError
            If it can't be written.
        """
        file = Path(path)
        designed_file(self._specification, self.result, self._periods).save(file)
        return file

    def _headline(self) -> str:
        series = self.result.trajectory
        return (
            f'{self.duration:g} s, {self._periods} periods of {series.f0:g} Hz with '
            f'{series.alpha.shape[1]} harmonics, condition number {self.condition_number:.1f} (5.2)'
        )

    def __repr__(self) -> str:
        """Return the figure that matters."""
        return f'<PlannedExcitation: {self._headline()}>'

    def _repr_html_(self) -> str:
        """Return a table for a notebook."""
        rows = [
            [
                margin.limit,
                margin.subject,
                float(margin.reached),
                float(margin.allowed),
                margin.unit,
            ]
            for margin in self.result.report.worst_of_each()
        ]
        return paragraph(self._headline()) + table(
            ['limit', 'closest', 'reached', 'allowed', 'unit'], rows
        )
