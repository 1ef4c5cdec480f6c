"""What the regression is built from: filtered kinematics and torque of one bag."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.spectral_filter import SpectralFilter

Array = npt.NDArray[np.float64]

FOLDS = 5
"""Parts of a motion, of which each is predicted from the others."""

BLOCKS = 5 * FOLDS
"""Consecutive pieces of a motion, which the parts are made of."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Conditioned motion of one bag at two rates.

    `fine` arrays, at a hundred times the cut-off or more, keep the steps of dry friction in
    place; the others, at five times the cut-off, are those that are fitted.

    Attributes
    ----------
    name : str
        Of the bag.
    recorded : int
        Recorded samples that went in.
    time : (M,) ndarray
        Of the decimated samples [s] since the bag's start.
    q, dq, ddq : (M, n) ndarray
        [rad], [rad/s], [rad/s^2]
    dq_fine, ddq_fine : (L, n) ndarray
        [rad/s], [rad/s^2]
    tau_raw, tau : (M, n) ndarray
        Measured torque as recorded and low-pass filtered [Nm].
    fine_filter, coarse_filter : SpectralFilter
        The torque's low-pass, for regressor columns at the fine (then decimating) and at the
        other rate: both sides of the equation pass the same filter.
    kept : (M,) ndarray of bool
        Samples away from the ends, where the filter has settled.
    measured : (M, n) ndarray of bool
        Kept, and the effort tells the joint's torque: not dead, not near saturation.
    usable : (M, n) ndarray of bool
        Rows to fit: measured, and the joint not standing still.
    block : (M,) ndarray of int
        Consecutive part of the motion, 0 .. `BLOCKS` - 1.
    """

    name: str
    recorded: int
    time: Array
    q: Array
    dq: Array
    ddq: Array
    dq_fine: Array
    ddq_fine: Array
    tau_raw: Array
    tau: Array
    fine_filter: SpectralFilter
    coarse_filter: SpectralFilter
    kept: npt.NDArray[np.bool_]
    measured: npt.NDArray[np.bool_]
    usable: npt.NDArray[np.bool_]
    block: npt.NDArray[np.intp]

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def fold(self) -> npt.NDArray[np.intp]:
        """(M,) part for cross-validation, 0 .. `FOLDS` - 1: blocks in turn.

        So every part has something of the whole motion. A fifth in one piece would be predicted
        from postures that it never takes, and judge extrapolation instead of the model.
        """
        return np.asarray(self.block % FOLDS)

    @property
    def step(self) -> int:
        """Every how many fine samples one is kept."""
        return self.fine_filter.decimation
