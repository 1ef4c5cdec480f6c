"""How late the efforts of a recording are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.samples import BLOCKS, Samples
from aerarm_ros.identification.conditioning.spectral_filter import SETTLING_PERIODS, SpectralFilter
from aerarm_ros.identification.model_choice.simple_fit import SIMPLE_TERMS, SharedColumns, SimpleFit
from aerarm_ros.identification.model_choice.standard_errors import standard_errors
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.joint_term import JointTerm, TermKind
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]

# Without it, friction that grows with the load would look like a delay.
_TERMS = (*SIMPLE_TERMS, JointTerm(TermKind.LOAD))
_SPREAD = 0.05  # [s] before any data: wide, as a narrow one would pull what is found towards 0
_ROUNDS = 10
_SETTLED = 5e-5  # [s]
_LEAST = 1e-3  # [s]: less is within what stamps and filters do
# Longer ones are no delays: friction that lags behind the velocity, as in gears that give way,
# looks like 20 to 100 ms in joints whose torque is mostly friction.
_MOST = 0.015  # [s]
_HOPELESS = 0.2  # [s]
_CLEAR = 2.0  # standard errors of a delay, and of how much better held-out parts are predicted


@dataclass(frozen=True, eq=False)
class EffortDelay:
    """Delay of each joint's effort behind its position.

    Attributes
    ----------
    found : (n,) ndarray
        What fits best [s], positive where the effort is late.
    used : (n,) ndarray
        The same where it is believed, else 0 [s].
    deviation : (n,) ndarray
        Standard deviation of what was found [s].
    in_time : bool
        Whether velocities are to be moved too, which are late themselves.
    """

    found: Array
    used: Array
    deviation: Array
    in_time: bool = False


def find_effort_delay(
    bags: Sequence[SampleColumns],
    cad: ArmParameters,
    in_time: Sequence[SampleColumns] | None = None,
) -> EffortDelay:
    """Look for delays of the efforts, one a joint, and test them on held-out parts.

    A torque that is late by d is that of the model less d times its rate: linear in d, for small
    ones. The rate is that of the predicted torque, for the measured one's is noisy and would make
    delays come out too small; what is found is taken off the measured torque and looked for again,
    until nothing is left.

    Parameters
    ----------
    bags : sequence of SampleColumns
        To identify from.
    cad : ArmParameters
    in_time : sequence of SampleColumns, optional
        The same with velocities moved to where positions say, if they are late: then delays are
        looked for there, and all signals are moved or none is.
    """
    n = bags[0].samples.n
    links = SimpleFit(bags, cad).theta[: 10 * n]
    plain = SimpleFit(bags, cad, (), _TERMS, links)
    judged = list(bags if in_time is None else in_time)
    fit = plain if in_time is None else SimpleFit(judged, cad, (), _TERMS, links)
    moved = judged
    found = np.zeros(n)
    for _ in range(_ROUNDS):
        columns = [_columns(bag, rate) for bag, rate in zip(moved, fit.rates(), strict=True)]
        fit = SimpleFit(moved, cad, columns, _TERMS, links)
        step = fit.theta[10 * n : 11 * n]
        found = found + step
        if np.abs(step).max() < _SETTLED or np.abs(found).max() > _HOPELESS:
            break
        moved = [_advanced(bag, found) for bag in judged]
    gain = _squares(bags, plain.residuals()) - _squares(judged, fit.residuals())
    clear = np.array([standard_errors(of_joint) for of_joint in gain.T]) > _CLEAR
    deviation = fit.deviations()[10 * n : 11 * n]
    size = np.abs(found)
    believed = clear & (size >= _LEAST) & (size <= _MOST) & (size > _CLEAR * deviation)
    if in_time is None:
        return EffortDelay(found, np.where(believed, found, 0.0), deviation)
    together = bool(believed.any()) and standard_errors(gain.sum(axis=1)) > _CLEAR
    return EffortDelay(found, np.where(believed & together, found, 0.0), deviation, together)


def _columns(bag: SampleColumns, rate: Array) -> SharedColumns:
    """Return the filtered torque per second of delay, of each joint for itself."""
    n = bag.samples.n
    columns = np.zeros((*rate.shape, n))
    joints = np.arange(n)
    columns[:, joints, joints] = -rate
    return SharedColumns(columns, np.full(n, _SPREAD))


def _advanced(bag: SampleColumns, delay: Array) -> SampleColumns:
    """Return a bag whose filtered torque is moved to an earlier time."""
    samples: Samples = bag.samples
    dt = float(samples.time[1] - samples.time[0])
    settling = None if samples.fine_filter.periodic else SETTLING_PERIODS * 5.0 * dt
    moved = [
        SpectralFilter(len(tau), dt, _lead(float(d)), settling=settling)(tau)
        for tau, d in zip(samples.tau.T, delay, strict=True)
    ]
    return bag.with_samples(replace(samples, tau=np.column_stack(moved)))


def _lead(seconds: float) -> Callable[[Array], npt.NDArray[np.complex128]]:
    """Return the gain of a shift to an earlier time."""
    return lambda frequency: np.asarray(np.exp(2j * np.pi * frequency * seconds))


def _squares(bags: Sequence[SampleColumns], residuals: Sequence[Array]) -> Array:
    """Return the (B, n) squared residuals of each block, joint by joint."""
    sums = []
    for bag, residual in zip(bags, residuals, strict=True):
        squares = np.nan_to_num(residual) ** 2
        sums.append([np.bincount(bag.samples.block, s, BLOCKS) for s in squares.T])
    return np.concatenate(np.swapaxes(np.array(sums), 1, 2))
