"""Test whether external joint torque follows gravity and inertia, as a payload's torque does."""

from collections import deque

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.external_torque import ExternalTorque, Unexplained
from aerarm_ros.online.information_filter import InformationFilter

_WINDOW = 2.0  # [s] of motion in which a payload must explain the torque
_PERIOD = 0.05  # [s] between rows; closer rows are correlated
_CORRELATED = 4.0  # rows that count as one
_NOTABLE = 0.6  # of the threshold, above which torque may be that of a payload
_EXPLAINED = 0.9  # fraction of the rows that a payload must explain
_EXCEEDED = 0.3  # fraction of the rows that the bare arm must not explain
_SIGNIFICANT = 3.0  # standard deviations of a payload's mass
_MEMORY = 20.0  # [s]
_LOAD_SHARE = 0.1  # of a payload's torque, error of friction and torque constants under load


class LoadTest:
    """Test whether a payload at the last link explains the external joint torque.

    The body's ten parameters follow from a recursive regression. The columns of the regression
    pass the torque's observer: `dr/dt = K (d/dt(Y_p pi) + Y_f pi + r)` with `MomentumRegressor`.
    The regression predicts each torque before it learns from it. So a push counts as a payload
    only if it follows gravity and inertia for 2 s of motion.

    Parameters
    ----------
    external : ExternalTorque
        Observer of the torque.
    mass, size : float
        Standard deviation of a payload's mass [kg], and its distance from the last joint [m].

    Attributes
    ----------
    torque : (n,) ndarray
        External torque of the detected payload [Nm], zeros without one.
    doubt : (n,) ndarray
        Largest error of the torque of detected and declared payload [Nm]: three standard deviations
        of the detected one, and a share for the friction and the torque constants under load.
    found, released : bool
        Whether the last `update` detected a payload or its change, or its end.
    mass, mass_std : float
        Mass of the detected payload and its standard deviation [kg]; negative if the model contains
        a body that the arm no longer carries.
    """

    def __init__(self, external: ExternalTorque, mass: float, size: float) -> None:
        self._gain, self._n = external.stage, external.n
        self._still = external.dynamics.still
        self._regressor = MomentumRegressor(external.dynamics.robot)
        self._own_mass = float(external.dynamics.robot.model.inertias[-1].mass)
        self._declared = np.zeros(10)
        self._scale = mass * np.array([1.0, *[size] * 3, *[size**2] * 6])
        self._filter = InformationFilter(10)
        self.torque = self.doubt = np.zeros(self._n)
        self.found = self.released = False
        self.mass = self.mass_std = float('nan')
        self._body: Array | None = None
        self._is_new = False  # the payload has changed and is not known yet
        self._momentum = np.zeros((self._n, 10))
        self._covariance = np.zeros((10, 10))
        self._window: deque[tuple[bool, bool, Array]] = deque(maxlen=round(_WINDOW / _PERIOD))
        self.pause()

    @property
    def is_loaded(self) -> bool:
        """Whether the arm carries a detected payload."""
        return self._body is not None

    def pause(self) -> None:
        """Restart the test after a gap in the data; a payload detected before is kept."""
        self._columns = np.zeros((self._n, 10))
        self._integral: Array | None = None
        self._due = self._quiet = 0.0

    def declare(self, payload: npt.ArrayLike) -> None:
        """Set the declared payload's inertial parameters (10,), and drop a detected payload."""
        self._declared = np.array(payload, dtype=float)
        self._drop()

    def rebase(self, q: Array, dq: Array, base: BaseMotion | None) -> None:
        """Keep the regression columns unchanged across lost states."""
        if self._integral is not None:
            momentum, _ = self._evaluate(q, dq, base)
            self._integral = self._integral + momentum - self._momentum
            self._momentum = momentum

    def update(
        self,
        state: ArmState,
        dt: float,
        row: Unexplained,
        threshold: Array,
        base: BaseMotion | None,
    ) -> None:
        """Process a joint state and the joint torque that the model does not explain."""
        self.found = self.released = False
        if not self._is_needed(row.residual, threshold, dt):
            return
        momentum, force = self._evaluate(state.q, state.dq, base)
        self._momentum = momentum
        if self._integral is None:
            self._integral, self._columns = momentum, np.zeros((self._n, 10))
        integral = self._integral + dt * -force
        gain = self._gain
        # The backward Euler steps of `ExternalTorque`, column by column.
        observed = gain * (momentum - integral) / (1.0 + dt * gain)
        self._integral = integral + dt * observed
        share = dt * gain / (1.0 + dt * gain)
        self._columns = self._columns + share * (observed - self._columns)
        self.doubt = _LOAD_SHARE * np.abs(self._columns @ self._declared)
        if self._body is not None:
            self.torque = -self._columns @ self._body
            rows = self._columns * self._scale
            variance = np.einsum('ij,jk,ik->i', rows, self._covariance, rows)
            self.doubt += _SIGNIFICANT * np.sqrt(np.maximum(variance, 0.0))
            self.doubt += _LOAD_SHARE * np.abs(self.torque)
        self._due += dt
        if self._due >= _PERIOD:
            self._due = 0.0
            self._learn(state, row, threshold)

    def suspect(self, ratio: Array, threshold: Array) -> None:
        """Reset the payload estimate at a new event, unless it explains the event's torque.

        Parameters
        ----------
        ratio, threshold : (n,) ndarray
            External torque relative to its threshold, and the threshold [Nm].
        """
        if self.is_loaded:
            return
        predicted = -self._columns @ (self._scale * self._filter.belief.mean) / threshold
        if np.linalg.norm(ratio - predicted) > 0.5 * np.linalg.norm(ratio):
            self._forget()

    def _evaluate(self, q: Array, dq: Array, base: BaseMotion | None) -> tuple[Array, Array]:
        motion = self._still if base is None else base
        return self._regressor.evaluate(q, dq, motion.specific_force, motion.angular_velocity)

    def _drop(self) -> None:
        """Forget a detected payload."""
        self._body, self._is_new = None, False
        self.torque = self.doubt = np.zeros(self._n)
        self._forget()

    def _forget(self) -> None:
        self._filter.forget(slice(None))
        self._window.clear()

    def _is_needed(self, residual: Array, threshold: Array, dt: float) -> bool:
        """Return whether the regression, which takes half of the computing time, must run."""
        if (
            self.is_loaded
            or self._declared.any()
            or bool((np.abs(residual) > _NOTABLE * threshold).any())
        ):
            self._quiet = 0.0
        elif self._quiet > _WINDOW:
            self._integral = None
            self._window.clear()
            return False
        self._quiet += dt
        return True

    def _learn(self, state: ArmState, row: Unexplained, threshold: Array) -> None:
        if np.abs(state.dq).max() < 0.02:
            return
        rows = -self._columns * self._scale
        belief = self._filter.belief
        predicted = rows @ belief.mean
        by_body = np.abs(row.residual - predicted) / threshold
        bare = np.abs(row.residual) / threshold
        self._window.append(
            (bool(bare.max() > 1.0), bool(by_body.max() < 1.0), predicted / threshold)
        )
        variance = _CORRELATED * (threshold / _SIGNIFICANT) ** 2
        variance = variance * np.maximum(1.0, by_body**2)
        kept = np.full(10, np.exp(-_PERIOD / _MEMORY))
        self._filter.update(rows, row.residual, variance, kept)
        if len(self._window) == self._window.maxlen:
            self._decide()

    def _decide(self) -> None:
        exceeded, explained, predicted = zip(*self._window, strict=True)
        belief = self._filter.belief
        mass = float(self._scale[0] * belief.mean[0])
        self._covariance = belief.covariance
        std = float(self._scale[0] * np.sqrt(self._covariance[0, 0]))
        if self._body is not None:
            self._body = self._scale * belief.mean
            self.mass, self.mass_std = mass, std
            # The bare arm explains a motion in which the payload would be noticed.
            contradicted = np.mean(explained) < 0.5 or abs(mass) < _SIGNIFICANT * std
            if np.mean(exceeded) < 1.0 - _EXPLAINED and contradicted:
                self._drop()
                self.released = True
            elif np.mean(explained) < 0.5:
                self._is_new = True  # more or less payload: learn it from now on
                self._forget()
            elif self._is_new and np.mean(explained) > _EXPLAINED and self._is_body(mass):
                self._is_new, self.found = False, True
            return
        varied = np.ptp(np.array(predicted), axis=0).max() > 1.0
        if (
            np.mean(exceeded) > _EXCEEDED
            and np.mean(explained) > _EXPLAINED
            and varied
            and abs(mass) > _SIGNIFICANT * std
            and self._is_body(mass)
        ):
            self._body, self.found = self._scale * belief.mean, True
            self.mass, self.mass_std = mass, std

    def _is_body(self, mass: float) -> bool:
        """Return whether a payload mass [kg] leaves the last link a positive mass."""
        return bool(mass > -self._own_mass - self._declared[0])
