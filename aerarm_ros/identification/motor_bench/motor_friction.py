"""Viscous and Coulomb friction of a drive from velocity steps, thesis (4.12)-(4.14)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.motion.signals import Array

RATE = 1000.0
"""Sampling rate of uniform times [Hz]."""
_SHORTEST = 0.5  # [s] shortest usable run
# Below this fraction of its top speed [-] a joint may stick, so its friction is undetermined.
_STICKING = 0.1


@dataclass(frozen=True, eq=False)
class MotorRun:
    """Measured motion of a joint while all other joints are at rest.

    Attributes
    ----------
    speed : float or None
        Commanded velocity, signed [rad/s]; None for acceleration runs and oscillations.
    time : (M,) ndarray
        Increasing time [s].
    q, dq, tau : (M,) ndarray
        Joint position [rad], velocity [rad/s], and torque from the measured current [Nm].
    swings : bool
        Whether the joint oscillates about the posture, to measure backlash.
    """

    speed: float | None
    time: Array
    q: Array
    dq: Array
    tau: Array
    swings: bool = False

    def is_long_enough(self) -> bool:
        """Return whether the run takes at least half a second."""
        return len(self.time) > 1 and bool(self.time[-1] - self.time[0] >= _SHORTEST)

    def uniform(self) -> tuple[Array, Array]:
        """Return positions and torques at uniform times, `RATE` per second."""
        time = np.arange(self.time[0], self.time[-1], 1.0 / RATE)
        return np.interp(time, self.time, self.q), np.interp(time, self.time, self.tau)

    def blocks(self, length: float) -> Array:
        """Return means (5, B) of sin(q), cos(q), dq, ddq and tau over time blocks of `length` [s].

        The means reduce noise and gear ripple.
        """
        since = self.time - self.time[0]
        index = (since / length).astype(int)
        # remaining samples belong to the last block
        index = np.minimum(index, max(index[-1] - 1, 0))
        count = np.maximum(np.bincount(index), 1)

        def mean(values: Array) -> Array:
            return np.asarray(np.bincount(index, weights=values) / count)

        # The acceleration is the slope of a linear fit to the velocities of each block.
        offset = since - mean(since)[index]
        spread = np.maximum(mean(offset**2), 1e-12)
        slope = mean(offset * self.dq) / spread
        others = (np.sin(self.q), np.cos(self.q), self.dq, self.tau)
        sine, cosine, dq, tau = map(mean, others)
        return np.array([sine, cosine, dq, slope, tau])


def moving_rows(dq: Array, spread: int, ends: int, step: int) -> npt.NDArray[np.intp]:
    """Return every `step`-th row of velocities (M,) in which the joint moves.

    Rows within `spread` samples of a standstill, and `ends` samples at both ends, are excluded.
    """
    slow = np.abs(dq) < _STICKING * np.abs(dq).max()
    # A filter spreads the effect of a standstill to neighbouring samples.
    free = np.convolve(slow, np.ones(2 * spread + 1), 'same') == 0.0
    free[:ends] = free[-ends:] = False
    return np.flatnonzero(free)[::step]


_BLOCK = 0.1  # [s]: noise of two blocks is independent
# Prior standard deviation of the fraction of transmitted torque lost in a gear. The prior is
# needed if the gravity torque barely varies, because the data then determine only the sum of this
# loss and Coulomb friction.
_LOAD_SPREAD = 0.05
_ROUNDS = 3  # repeated, because gravity torque and load-dependent friction depend on each other
_LEAST_BLOCKS = 4


@dataclass(frozen=True, eq=False)
class MotorFriction:
    """Joint-side friction of one drive, and gravity torque if the drive is mounted in an arm.

    `tau = viscous dq + (coulomb + load |g(q)|) sgn(dq) + g(q)`, `g(q) = a sin q + b cos q`.
    The friction model is exact for a joint that rotates alone about a fixed axis, for any load.

    Attributes
    ----------
    viscous, coulomb : float
        Viscous friction b_eq / k_g^2 [Nms/rad] and Coulomb friction f [Nm] of thesis (4.11).
    load : float
        Friction per gravity torque [-], 0 for a bare motor.
    gravity : (2,) ndarray
        Coefficients a and b of the gravity torque [Nm], zero for a bare motor.
    covariance : (5, 5) ndarray
        Covariance of viscous, coulomb, load, a, b.
    speed, torque : (K,) ndarray
        Mean velocity of each step [rad/s], and mean torque without gravity and load-dependent
        friction [Nm].
    """

    viscous: float
    coulomb: float
    load: float
    gravity: Array
    covariance: Array
    speed: Array
    torque: Array

    @property
    def std(self) -> Array:
        """Standard deviations (5,) of the coefficients viscous, coulomb, load, a, b."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def gravity_torque(self, q: Array) -> Array:
        """Return the gravity torque g(q) [Nm]."""
        return np.asarray(np.column_stack([np.sin(q), np.cos(q)]) @ self.gravity)

    def load_torque(self, q: Array, dq: Array) -> Array:
        """Return the gravity torque plus the gear friction that gravity causes [Nm]."""
        gravity = self.gravity_torque(q)
        return np.asarray(gravity + self.load * np.abs(gravity) * np.sign(dq))


def fit_motor_friction(
    runs: Sequence[MotorRun], mounted: bool, name: str, inertia: float = 0.0
) -> MotorFriction:
    """Fit the friction of one joint to its velocity steps by least squares, thesis (4.14).

    Parameters
    ----------
    runs : sequence of MotorRun
        Velocity steps, each speed in both directions.
    mounted : bool
        Whether gravity acts on the joint's load; False for a bare motor on a bench.
    name : str
        Name of the joint, for error messages.
    inertia : float
        Inertia that the joint accelerates [kg m^2]. The thesis neglects the inertia torque, but
        in a fit an acceleration of 0.1 rad/s^2, from a velocity loop that has not settled, looks
        like negative viscous friction.

    Raises
    ------
    IdentificationError
        If the steps do not separate the parameters, or the friction is negative.
    """
    runs = [run for run in runs if len(run.time)]
    blocks = [run.blocks(_BLOCK) for run in runs]
    sine, cosine, dq, ddq, tau = np.hstack([np.zeros((5, 0)), *blocks])
    _check_steps(name, runs, blocks, dq)
    tau = tau - inertia * ddq
    theta, covariance = np.zeros(5), np.zeros((5, 5))
    used = np.arange(5 if mounted else 2)
    for _ in range(_ROUNDS if mounted else 1):
        columns = _columns(sine, cosine, dq, theta[3:])[:, used]
        theta[used], covariance[np.ix_(used, used)] = _solve(columns, tau, name)
    if theta[1] < 0.0:
        raise IdentificationError(
            f'{name}: the measured Coulomb friction, {theta[1]:.3g} Nm, is negative; check the '
            'sign of the motor in the configuration, and that nothing pushes the joint'
        )
    known = _columns(sine, cosine, dq, theta[3:])[:, 2:] @ theta[2:]
    index = np.repeat(np.arange(len(blocks)), [block.shape[1] for block in blocks])
    count = np.bincount(index)
    return MotorFriction(
        viscous=float(theta[0]),
        coulomb=float(theta[1]),
        load=float(theta[2]),
        gravity=theta[3:],
        covariance=covariance,
        speed=np.bincount(index, dq) / count,
        torque=np.bincount(index, tau - known) / count,
    )


def _columns(sine: Array, cosine: Array, dq: Array, gravity: Array) -> Array:
    """Return regressor columns of viscous, coulomb, load, a, b; thesis (4.13) has two of these."""
    sign = np.sign(dq)
    load = np.abs(gravity[0] * sine + gravity[1] * cosine)
    return np.column_stack([dq, sign, load * sign, sine, cosine])


def _solve(columns: Array, tau: Array, name: str) -> tuple[Array, Array]:
    """Return parameters (5,) and covariance; only the load-dependent friction has a prior."""
    rank = np.linalg.matrix_rank(columns[:, np.linalg.norm(columns, axis=0) > 0.0])
    if rank < min(2, columns.shape[1]):
        raise IdentificationError(
            f'{name}: all steps have the same speed; check that the joint follows its reference'
        )
    std = np.ones(columns.shape[1])
    for _ in range(2):  # the residual of the first solution determines the noise
        prior = np.zeros((1, columns.shape[1]))
        if columns.shape[1] > 2:
            prior[0, 2] = 1.0 / _LOAD_SPREAD
        noise = float(std[0])
        rows = np.vstack([columns / noise, prior])
        right = np.append(tau / noise, 0.0)
        theta, *_ = np.linalg.lstsq(rows, right, rcond=None)
        # a gear cannot add torque, so the coefficient is not negative
        if columns.shape[1] > 2 and theta[2] < 0.0:
            free = [0, 1, 3, 4]
            theta = np.zeros(5)
            theta[free], *_ = np.linalg.lstsq(rows[:, free], right, rcond=None)
        residual = tau - columns @ theta
        freedom = max(len(tau) - columns.shape[1], 1)
        std[0] = max(float(np.sqrt(residual @ residual / freedom)), 1e-9)
    return theta, np.linalg.pinv(rows.T @ rows)


def _check_steps(name: str, runs: Sequence[MotorRun], blocks: Sequence[Array], dq: Array) -> None:
    if len(dq) < _LEAST_BLOCKS:
        raise IdentificationError(
            f'{name}: only {len(dq)} intervals of {_BLOCK:g} s at constant speed were found; '
            'check that joint_states arrive while the bench moves'
        )
    still = [
        run.speed
        for run, (_, _, velocity, *_) in zip(runs, blocks, strict=True)
        if run.speed is not None and abs(np.mean(velocity)) < 0.5 * abs(run.speed)
    ]
    if still:
        raise IdentificationError(
            f'{name}: the joint does not reach {still[0]:.3g} rad/s; check that the joint is free '
            'to move and that its velocity loop is not saturated'
        )
    if not (dq.min() < 0.0 < dq.max()):
        raise IdentificationError(
            f'{name}: all steps have the same direction, but both directions are needed'
        )


@dataclass(frozen=True, eq=False)
class MotorSupply:
    """Electrical measurements of one motor on the bench.

    Attributes
    ----------
    time : (M,) ndarray
        Increasing time [s]; empty if power is not measured.
    current, speed, power : (M,) ndarray
        Quadrature current [A], motor speed [rad/s], and electrical power from the reported voltage,
        3/2 u_q i_q [W].
    reported : float
        Phase resistance that the board reports [ohm]; NaN if unavailable.
    """

    time: Array
    current: Array
    speed: Array
    power: Array
    reported: float = float('nan')


VOLTAGE, BOARD = 'voltage', 'board'

# [A] some counts of the current measurement; at lower currents the ratio of power and current is
# inaccurate
_DIVISIBLE = 0.004
# Smallest mean current of a block [A]. Noise of the current affects both sides of the fit, and at
# small currents would bias the resistance towards zero.
_LEAST_CURRENT = 0.1
_LEAST_RESISTANCE_BLOCKS = 6
_KNOWN = 0.3  # relative standard deviation above which a resistance counts as unknown


@dataclass(frozen=True)
class MotorResistance:
    """Phase resistance of a motor.

    Attributes
    ----------
    ohm, std : float
        Resistance and its standard deviation [ohm].
    source : str
        'voltage': measured with the voltage that the board reports; 'board': resistance that the
        board reports.
    """

    ohm: float
    std: float
    source: str


def find_resistance(supply: MotorSupply, board_uncertainty: float) -> MotorResistance | None:
    """Return a motor's phase resistance, None if it cannot be determined.

    Parameters
    ----------
    board_uncertainty : float
        Relative standard deviation of a resistance that a board reports [-].
    """
    stated = supply.reported
    for found in (_fit(supply), MotorResistance(stated, board_uncertainty * stated, BOARD)):
        if found is not None and 0.0 <= found.std < _KNOWN * found.ohm:  # excludes NaN
            return found
    return None


def _fit(supply: MotorSupply) -> MotorResistance | None:
    """Fit ``u_q = R i_q + k omega_m``, thesis (4.1) divided by 3/2 i_q, by least squares."""
    divisible = np.abs(supply.current) > _DIVISIBLE
    current, speed = supply.current[divisible], supply.speed[divisible]
    voltage = supply.power[divisible] / (1.5 * current)
    numbers = np.floor(supply.time[divisible] / _BLOCK)
    _, block, count = np.unique(numbers, return_inverse=True, return_counts=True)
    sums = [np.bincount(block, weights=values) for values in (current, speed, voltage)]
    means = np.column_stack(sums) / count[:, np.newaxis]
    flowing = np.abs(means[:, 0]) > _LEAST_CURRENT
    if flowing.sum() < _LEAST_RESISTANCE_BLOCKS:
        return None
    rows = np.sqrt(count[flowing])[:, np.newaxis] * means[flowing]
    columns, rest = rows[:, :2], rows[:, 2]
    theta, _, rank, _ = np.linalg.lstsq(columns, rest, rcond=None)
    if rank < columns.shape[1]:
        return None
    residual = rest - columns @ theta
    variance = residual @ residual / (len(rest) - columns.shape[1])
    covariance = variance * np.linalg.inv(columns.T @ columns)
    return MotorResistance(float(theta[0]), float(np.sqrt(covariance[0, 0])), VOLTAGE)
