"""Trajectories with random coefficients, thesis section 3.4.1."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerarm_ros.excitation.feasibility.feasibility_checker import FeasibilityChecker
from aerarm_ros.excitation.feasibility.feasibility_report import FeasibilityReport, LimitMargin
from aerarm_ros.excitation.settings.excitation_error import (
    DesignStoppedError,
    ExcitationError,
    NothingDrawnError,
)
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True, eq=False)
class RandomTrajectory:
    """Distribution of trajectories: coefficients uniform in +-amplitude, bias in +-spread.

    Parameters
    ----------
    bias : (n,) centre of the motion [rad].
    bias_spread : (n,) or scalar, largest random term added to it [rad].
    amplitude : largest coefficient [rad].
    fundamental : f0 [Hz].
    harmonics : N.

    Raises
    ------
    ExcitationError
        If a value is out of range.
    """

    bias: FloatArray
    bias_spread: FloatArray | float = 0.1
    amplitude: float = 0.35
    fundamental: float = 0.1
    harmonics: int = 5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and self.amplitude > 0.0):
            raise ExcitationError(f'amplitude must be positive, got {self.amplitude} rad')
        if self.harmonics < 1 or self.harmonics != int(self.harmonics):
            raise ExcitationError(f'at least one harmonic is needed, got {self.harmonics}')
        if not (np.isfinite(self.fundamental) and self.fundamental > 0.0):
            raise ExcitationError(f'fundamental must be positive, got {self.fundamental} Hz')

    def draw(self, generator: np.random.Generator) -> FourierTrajectory:
        """Return the next trajectory of `generator`."""
        n = len(self.bias)
        spread = generator.uniform(-self.bias_spread, self.bias_spread, n)
        alpha, beta = generator.uniform(-self.amplitude, self.amplitude, (2, n, self.harmonics))
        return FourierTrajectory(self.fundamental, self.bias + spread, alpha, beta)

    def draw_feasible(
        self,
        seed: int,
        checker: FeasibilityChecker,
        ramp_time: float,
        attempts: int = 500,
        stop: Callable[[], bool] = lambda: False,
    ) -> tuple[FourierTrajectory, FeasibilityReport]:
        """Return the first feasible trajectory of the sequence that `seed` starts.

        Parameters
        ----------
        seed : the same seed and limits give the same trajectory.
        checker : limits, over the whole period with run-in and run-out.
        ramp_time : run-in and run-out [s].
        attempts : how many are drawn at most.
        stop : asked before each; True gives up.

        Raises
        ------
        NothingDrawnError
            If none is feasible; names the limit that most of them break.
        DesignStoppedError
            If asked to stop.
        """
        generator = np.random.default_rng(seed)
        broken: list[LimitMargin] = []
        for _ in range(attempts):
            if stop():
                raise DesignStoppedError('stopped before a feasible random trajectory was found')
            trajectory = self.draw(generator)
            report = checker.check_trajectory(trajectory, ramp_time, stop_early=True)
            if report.feasible:
                return trajectory, report
            broken.append(report.binding)
        raise self._error(broken, seed)

    def _error(self, broken: list[LimitMargin], seed: int) -> NothingDrawnError:
        (limit, subject), count = Counter((m.limit, m.subject) for m in broken).most_common(1)[0]
        best = max(
            (m for m in broken if (m.limit, m.subject) == (limit, subject)),
            key=lambda margin: margin.relative,
        )
        binding = (
            f'{limit} of {subject} binds in {100 * count / len(broken):.0f} % of them '
            f'({best.reached:.4g} {best.unit} at best, limit {best.allowed:.4g} {best.unit})'
        )
        return NothingDrawnError(
            f'none of {len(broken)} random trajectories (seed {seed}) is feasible; {binding}: '
            f'lower the amplitude ({self.amplitude:g} rad) or the fundamental '
            f'({self.fundamental:g} Hz), or check that limit and the bias',
            binding,
        )
