"""Estimation of gear backlash from oscillations, in which the link moves between tooth flanks."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_friction import (
    RATE,
    MotorFriction,
    MotorRun,
    moving_rows,
)
from aerarm_ros.motion.signals import Array

LARGEST = 0.1  # [rad] largest backlash that is searched
_CUTOFF = 25.0  # [Hz] low-pass filter of torques, because the torque of impacts is not modelled
# [Hz] low-pass filter of the motor's velocity, whose quantization would excite the link
_SMOOTH = 50.0
_ORDER = 3
_EDGE = 0.1  # [s] excluded at both ends, where the filter has samples on one side only
_BACKLASHES, _SCALES, _ROUNDS = 41, 9, 3
_WIDTH = 4.0  # [standard deviations] range on both sides that the next round covers
_SHARP = 2.0  # [grid steps] least standard deviation
_CLEAR = 3.0  # [standard deviations] by which a significant backlash exceeds zero
_DIGITS = 6  # decimal places of a backlash [rad]
_SURE = 3e-4  # [rad] least standard deviation, for errors of impacts and filters


def fit_backlash(
    runs: Sequence[MotorRun],
    friction: MotorFriction,
    links: tuple[float, float],
    rotor: tuple[float, float],
    name: str,
) -> tuple[float, float]:
    """Return the backlash of a gear at the joint, and the standard deviation [rad].

    An encoder on the motor does not measure the link, but the backlash affects the motor. When the
    motor brakes, the link leaves the driving flank. Until the opposite flank makes contact, the
    motor accelerates only its own inertia. For an assumed backlash, the motion of the link is
    computed from that of the motor: coupled while in contact, free under gravity without contact.
    The contact torque is then computed from the motion of the link. The estimate is the backlash
    whose torque fits the measured torque best. Motor inertia, viscous and dry friction are fitted
    simultaneously; the links' inertia varies within its uncertainty.

    Parameters
    ----------
    runs : sequence of MotorRun
        Oscillations of the joint.
    friction : MotorFriction
        Gravity and load-dependent friction from the velocity steps.
    links, rotor : tuple of two floats
        Joint-side inertia of the load (links) and of the drive (rotor), each with its standard
        deviation [kg m^2].
    name : str
        Name of the joint, for error messages.

    Raises
    ------
    IdentificationError
        If the recordings are too short.
    """
    swings = [_Swing(run) for run in runs if run.is_long_enough()]
    if not swings:
        raise IdentificationError(
            f'{name}: the oscillations are shorter than 0.5 s; measure more oscillations'
        )
    backlashes = np.linspace(0.0, 1.0, _BACKLASHES) ** 2 * LARGEST
    spread = 2.0 * links[1] / links[0]
    scales = np.linspace(max(1.0 - spread, 0.2), 1.0 + spread, _SCALES)
    mean = std = 0.0
    for _ in range(_ROUNDS):
        backlash, scale = (grid.ravel() for grid in np.meshgrid(backlashes, scales))
        misfit = _misfit(swings, friction, backlash, scale * links[0], rotor)
        misfit += ((scale - 1.0) * links[0] / links[1]) ** 2
        weight = (
            np.exp(-0.5 * (misfit - misfit.min())).reshape(len(scales), len(backlashes)).sum(axis=0)
        )
        weight *= np.gradient(backlashes)
        mean = float(weight @ backlashes / weight.sum())
        std = float(np.sqrt(weight @ (backlashes - mean) ** 2 / weight.sum()))
        near = int(np.argmin(np.abs(backlashes - mean)))
        std = max(std, _SHARP * float(np.gradient(backlashes)[near]), _SURE)
        low, high = mean - _WIDTH * std, mean + _WIDTH * std
        backlashes = np.linspace(max(low, 0.0), min(high, LARGEST), _BACKLASHES)
    return round(mean, _DIGITS), std


def is_significant(found: tuple[float, float]) -> bool:
    """Return whether a backlash is significant relative to its standard deviation [rad]."""
    return found[0] > _CLEAR * found[1]


def is_largest(found: tuple[float, float]) -> bool:
    """Return whether a backlash [rad] may exceed the limit `LARGEST`, given its uncertainty."""
    return found[0] > LARGEST - _CLEAR * found[1]


class _Swing:
    """Recorded oscillations: motor motion on a uniform time grid, and filtered torque."""

    def __init__(self, run: MotorRun) -> None:
        # Local import, because scipy.signal takes longer to import than the rest of this module.
        from scipy.signal import butter, sosfiltfilt

        self.q, tau = run.uniform()
        sections = [butter(_ORDER, f, fs=RATE, output='sos') for f in (_CUTOFF, _SMOOTH)]
        self._sections = sections[0]
        self.dq = np.gradient(sosfiltfilt(sections[1], self.q)) * RATE
        self.ddq = np.gradient(self.dq) * RATE
        self.tau = self.filtered(tau)
        self.way = self.filtered(np.sign(self.dq))
        columns = (acceleration(self.filtered(self.q)), self.dq, self.way, np.ones(len(tau)))
        self.columns = np.column_stack(columns)
        independent = round(0.5 * RATE / _CUTOFF)
        self.rows = moving_rows(self.dq, independent, round(_EDGE * RATE), independent)

    def filtered(self, values: Array) -> Array:
        """Return values (M, ...) low-pass filtered along the first axis, without delay."""
        from scipy.signal import sosfiltfilt

        return np.asarray(sosfiltfilt(self._sections, values, axis=0))

    def link(self, backlash: Array, gravity: Array) -> Array:
        """Return the link's angles (M, K) [rad] for K assumed backlashes [rad]."""
        half, side = 0.5 * backlash, np.zeros(len(backlash))
        x, v = np.full(len(backlash), self.q[0]), np.full(len(backlash), self.dq[0])
        way = np.empty((len(self.q), len(backlash)))
        motion = zip(self.q.tolist(), self.dq.tolist(), self.ddq.tolist(), strict=True)
        for row, (q, dq, ddq) in enumerate(motion):
            pull = gravity[0] * np.sin(x) + gravity[1] * np.cos(x)
            touches = side != 0.0
            v = np.where(touches, dq, v - pull / RATE)
            x = np.where(touches, q + side * half, x + v / RATE)
            # A tooth flank only pushes; the link leaves the flank where the flank would have to
            # pull.
            side = np.where((ddq + pull) * side > 0.0, 0.0, side)
            ahead = x - q
            met = ~touches & (np.abs(ahead) >= half)
            side = np.where(met, np.sign(ahead), side)
            x = np.where(met, q + side * half, x)
            way[row] = x
        return way


def acceleration(position: Array) -> Array:
    """Return second differences of positions along the first axis [rad/s^2]."""
    return np.asarray(np.gradient(np.gradient(position, axis=0), axis=0) * RATE**2)


def _misfit(
    swings: Sequence[_Swing],
    friction: MotorFriction,
    backlash: Array,
    links: Array,
    rotor: tuple[float, float],
) -> Array:
    """Return squared torque residuals (K,) for K backlashes, relative to the best fit's noise."""
    gravity = friction.gravity[:, np.newaxis] / links
    columns, torque = [], []
    for swing in swings:
        way = swing.link(backlash, gravity)
        pull = friction.gravity[0] * np.sin(way) + friction.gravity[1] * np.cos(way)
        flank = links * acceleration(swing.filtered(way)) + swing.filtered(pull)
        dry = friction.load * np.abs(flank) * swing.way[:, np.newaxis]
        columns.append(swing.columns[swing.rows])
        torque.append((swing.tau[:, np.newaxis] - flank - dry)[swing.rows])
    rows, right = np.vstack(columns), np.vstack(torque)
    noise = float(np.sqrt(_squares(rows, right).min() / max(len(rows) - 6, 1)))
    # The prior of the rotor inertia is an additional row, in units of the noise.
    weight = noise / rotor[1]
    rows = np.vstack([rows, [[weight, 0.0, 0.0, 0.0]]])
    right = np.vstack([right, np.full(len(links), weight * rotor[0])])
    return np.asarray(_squares(rows, right) / noise**2)


def _squares(rows: Array, right: Array) -> Array:
    """Return the squared residual (K,) of the least-squares fit to each column of `right`."""
    q, _ = np.linalg.qr(rows)
    return np.asarray(((right - q @ (q.T @ right)) ** 2).sum(axis=0))
