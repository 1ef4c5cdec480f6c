"""Rotor inertia of a drive from acceleration runs: J_eq of thesis (4.11)."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.motor_bench.motor_friction import MotorFriction
from aerarm_ros.identification.motor_bench.motor_run import MotorRun
from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

_RATE = 1000.0  # [Hz] of the uniform grid
_CUTOFF = 12.0  # [Hz] of the zero-phase low-pass: a run's own frequencies lie below
_ORDER = 3
_ENDS = 5  # such times at both ends, where the filter knows one side only
_STEP = 20  # samples from one row to the next
_INDEPENDENT = 0.5 / _CUTOFF  # [s] between samples with independent noise
_SHORTEST = 0.5  # [s]
# Slower than this share of its top speed [-] a joint may stick, and friction is then anything.
_STICKING = 0.1


def fit_inertia(
    runs: Sequence[MotorRun], friction: MotorFriction, name: str
) -> tuple[float, float]:
    """Return everything that a joint has to accelerate, and its standard deviation [kg m^2].

    Gravity is known from the velocity steps. Viscous and Coulomb friction are fitted again,
    since runs are faster than steps. Torque and regressor pass the same filter, so that the
    balance (4.11) holds for what is left.

    Parameters
    ----------
    runs : sequence of MotorRun
        Acceleration runs of one joint.
    friction : MotorFriction
        Of its velocity steps.
    name : str
        Of the joint, for errors.

    Raises
    ------
    IdentificationError
        If the runs are too short or the inertia is not positive.
    """
    filtered = [_filtered(run, friction) for run in runs if _long_enough(run)]
    if not filtered:
        raise IdentificationError(f'{name}: its acceleration runs are shorter than {_SHORTEST} s')
    columns, torque = (np.concatenate(part) for part in zip(*filtered, strict=True))
    theta, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    residual = torque - columns @ theta
    variance = residual @ residual / max(len(torque) - columns.shape[1], 1)
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    if theta[0] <= 0.0:
        raise IdentificationError(
            f'{name}: its inertia comes out as {theta[0]:.3g} kg m^2, not above zero: check the '
            'sign of the motor, and raise the acceleration share'
        )
    return float(theta[0]), float(np.sqrt(covariance[0, 0]))


def _long_enough(run: MotorRun) -> bool:
    return len(run.time) > 1 and bool(run.time[-1] - run.time[0] >= _SHORTEST)


def _filtered(run: MotorRun, friction: MotorFriction) -> tuple[Array, Array]:
    """Return the columns ddq, dq, sgn(dq) and the torque without gravity, filtered alike."""
    # Imported here: it takes longer than all the rest of this module.
    from scipy.signal import butter, sosfiltfilt

    time = np.arange(run.time[0], run.time[-1], 1.0 / _RATE)
    q, tau = np.interp(time, run.time, run.q), np.interp(time, run.time, run.tau)
    low_pass = butter(_ORDER, _CUTOFF, fs=_RATE, output='sos')
    smooth = sosfiltfilt(low_pass, q)
    dq = np.gradient(smooth, 1.0 / _RATE)
    ddq = np.gradient(dq, 1.0 / _RATE)
    rest = tau - friction.load_torque(smooth, dq)
    edge = round(_INDEPENDENT * _RATE)
    columns = np.column_stack([ddq, dq, sosfiltfilt(low_pass, np.sign(dq))])
    # The filter carries what happens at standstill into its neighbourhood.
    slow = np.abs(dq) < _STICKING * np.abs(dq).max()
    free = np.convolve(slow, np.ones(2 * edge + 1), 'same') == 0.0
    free[: _ENDS * edge] = free[-_ENDS * edge :] = False
    rows = np.flatnonzero(free)[::_STEP]
    return columns[rows], sosfiltfilt(low_pass, rest)[rows]
