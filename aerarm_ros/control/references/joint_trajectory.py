"""Joint trajectory received from a planner, checked against the limits of the arm."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference

Rows = Sequence[Sequence[float]] | Sequence[Array] | Array

# Closer to a limit, in rad or as a fraction of it, samples of a path do not prove that it is kept.
_NEAR = 0.05


class JointTrajectory:
    """Validated joint trajectory: points that the joints pass at given times.

    Parameters
    ----------
    names : sequence of str
        Names of the columns' joints, in any order.
    times : sequence of float
        Time of each point from the start [s], strictly increasing, not negative.
    positions : (M, n) sequence
        Joint positions at the points [rad].
    velocities, accelerations : (M, n) sequences, optional
        Velocities [rad/s] and accelerations [rad/s^2]; `path` fills in missing ones and empty rows.
    staying : (n,) ndarray, optional
        Positions [rad] at which omitted joints stay. Without it, `names` must be all joints.
    what : str
        Kind of the input, for error messages.

    Attributes
    ----------
    times : (M,) ndarray
    q : (M, n) ndarray
    dq, ddq : (M, n) ndarray or None

    Raises
    ------
    RejectedInputError
        If names, numbers or times are wrong, or a point is outside the limits.
    """

    def __init__(
        self,
        limits: JointLimits,
        names: Sequence[str],
        times: Sequence[float],
        positions: Rows,
        velocities: Rows | None = None,
        accelerations: Rows | None = None,
        staying: Array | None = None,
        what: str = 'trajectory',
    ) -> None:
        if staying is None:
            limits.order(names)  # requires all joints
        order = limits.part(names)
        self.times = checked_times(what, times)
        size = len(self.times), len(names)
        rows: list[Array | None] = []
        quantities = {
            'positions': positions,
            'velocities': velocities,
            'accelerations': accelerations,
        }
        for name, given in quantities.items():
            found = checked_rows(f'{what}: {name}', given, *size)
            if found is not None:
                resting = np.zeros(limits.n) if rows or staying is None else staying
                found, values = np.tile(resting, (size[0], 1)), found
                found[:, order] = values
            rows.append(found)
        q, self.dq, self.ddq = rows
        if q is None:
            raise RejectedInputError(f'{what}: no positions; set positions of every point')
        self.q = q
        if self.ddq is not None and self.dq is None:
            raise RejectedInputError(
                f'{what}: the points have accelerations without velocities; set both or neither'
            )
        limits.check(what, q, self.dq, self.ddq)
        self._limits = limits

    @property
    def is_single_point(self) -> bool:
        """Whether the trajectory is a single point at time zero, as streamed references are."""
        return len(self.times) == 1 and self.times[0] == 0.0

    def posture(self) -> JointReference:
        """Return the posture of the last point as a reference at rest.

        Raises
        ------
        RejectedInputError
            If the point has a velocity.
        """
        self._check_end()
        return JointReference.at_rest(self.q[-1])

    def path(
        self,
        start: Array,
        elapsed: float = 0.0,
        start_dq: Array | None = None,
        start_ddq: Array | None = None,
    ) -> PolynomialPath:
        """Return the path of quintic polynomials through the points of the trajectory.

        A trajectory whose first point is in the future begins at `start`. Missing velocities and
        accelerations are the slopes between neighbouring points, zero at the ends.

        Parameters
        ----------
        start : (n,) ndarray
            Present reference [rad].
        elapsed : float
            Part of the time to the first point that has passed when the motion begins [s].
        start_dq, start_ddq : (n,) ndarray, optional
            Present velocity [rad/s] and acceleration [rad/s^2]; default: at rest.

        Raises
        ------
        RejectedInputError
            If the motion leaves the limits between points, or does not end at rest.
        """
        times, q, dq, ddq = self.times, self.q, self.dq, self.ddq
        zero = np.zeros_like(start)
        begins_here = times[0] > elapsed
        if begins_here:
            times = np.concatenate([[0.0], times - elapsed])
            q = np.vstack([start, q])
            dq = None if dq is None else np.vstack([zero, dq])
            ddq = None if ddq is None else np.vstack([zero, ddq])
        self._check_end()
        if dq is None:
            dq = slopes(times, q)
        if begins_here and start_dq is not None:
            dq[0] = start_dq
        if ddq is None:
            ddq = slopes(times, dq)
        if begins_here and start_ddq is not None:
            ddq[0] = start_ddq
        path = PolynomialPath.quintic(times, q, dq, ddq)
        self._check_between(path, self._limits.including(start))
        return path

    def _check_between(self, path: PolynomialPath, limits: JointLimits) -> None:
        samples = path.sample()
        parts = [samples]
        near = (samples.q < limits.position_min + _NEAR).any()
        near |= (samples.q > limits.position_max - _NEAR).any()
        for values, largest in (
            (samples.dq, limits.velocity_max),
            (samples.ddq, limits.acceleration_max),
        ):
            near |= (np.abs(values) > (1.0 - _NEAR) * largest).any()
        if near:
            parts.append(path.extremes())
        for part in parts:
            limits.check('trajectory between its points', *part)

    def _check_end(self) -> None:
        if self.dq is None:
            return
        speed, largest = np.abs(self.dq[-1]), 1e-3 * self._limits.velocity_max
        if np.any(speed > largest):
            joint = int(np.argmax(speed / largest))
            raise RejectedInputError(
                f'trajectory: the last point has a velocity, {self._limits.names[joint]} '
                f'{speed[joint]:.3g} rad/s (limit {largest[joint]:.3g}); end at rest, or stream '
                'single points'
            )


def checked_times(what: str, times: Sequence[float]) -> Array:
    """Return times (M,) [s] of points; raise RejectedInputError unless they are 0 or more, rising.

    `what` is the input, for the message.
    """
    t = np.array(times, dtype=float)
    if t.ndim != 1 or not t.size:
        raise RejectedInputError(f'{what}: no points')
    if not np.all(np.isfinite(t)) or t[0] < 0.0:
        raise RejectedInputError(f'{what}: times must be finite and not negative')
    if np.any(np.diff(t) <= 0.0):
        index = int(np.argmax(np.diff(t) <= 0.0)) + 1
        raise RejectedInputError(
            f'{what}: point {index} at {t[index]:g} s does not follow point {index - 1} at '
            f'{t[index - 1]:g} s; times must increase'
        )
    return t


def checked_rows(what: str, rows: Rows | None, points: int, n: int) -> Array | None:
    """Return rows as array (points, n), None if all are empty; raise RejectedInputError."""
    if rows is None or all(len(row) == 0 for row in rows):
        return None
    wrong = [f'point {i} has {len(row)}' for i, row in enumerate(rows) if len(row) != n]
    if len(rows) != points or wrong:
        found = wrong[0] if wrong else f'{len(rows)} points have values'
        raise RejectedInputError(
            f'{what}: {found} instead of {n if wrong else points}; give {n} values for every point'
        )
    values = np.array(rows, dtype=float)
    if not np.all(np.isfinite(values)):
        raise RejectedInputError(f'{what} must be finite numbers; check their publisher')
    return values


def slopes(times: Array, values: Array) -> Array:
    """Return the slope at each point by finite differences; zero at the first and last point."""
    found = np.zeros_like(values)
    if len(times) > 2:
        found[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, np.newaxis]
    return found
