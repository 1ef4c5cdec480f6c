"""Tells a payload, which follows gravity and inertia, from other external torque."""

from collections import deque

import numpy as np

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.external_torque import ExternalTorque, Unexplained
from aerarm_ros.online.information_filter import InformationFilter

_WINDOW = 2.0  # [s] of motion in which a payload has to explain the torque
_PERIOD = 0.05  # [s] between rows, which are correlated within it
_CORRELATED = 4.0  # rows that count as one
_NOTABLE = 0.6  # of the threshold, above which torque may be a payload's
_EXPLAINED = 0.9  # share of the rows that a payload has to explain
_EXCEEDED = 0.3  # share of them that the bare arm must not explain
_SIGNIFICANT = 3.0  # standard deviations of a payload's mass
_MEMORY = 20.0  # [s]


class LoadTest:
    """Test whether a body at the last link explains the external torque.

    The body's ten parameters follow from a recursive regression whose columns pass the same
    observer as the torque: `dr/dt = K (d/dt(Y_p pi) + Y_f pi + r)` with `MomentumRegressor`. Its
    prediction counts before it has seen the torque. So a push is no payload unless it follows
    gravity and inertia for 2 s of motion.

    Parameters
    ----------
    external : ExternalTorque
    mass, size : float
        Standard deviation of a payload's mass [kg], and its distance from the last joint [m].

    Attributes
    ----------
    torque : (n,) ndarray
        External torque of the payload that was found [Nm], zeros if there is none.
    found, released : bool
        Whether the last `update` has found a payload, or that it is no longer there.
    mass, mass_std : float
        [kg]
    """

    def __init__(self, external: ExternalTorque, mass: float, size: float) -> None:
        self._gain, self._n = external.stage, external.n
        self._still = external.dynamics.still
        self._regressor = MomentumRegressor(external.dynamics.robot)
        self._scale = mass * np.array([1.0, *[size] * 3, *[size**2] * 6])
        self._filter = InformationFilter(10)
        self.torque = np.zeros(self._n)
        self.found = self.released = False
        self.mass = self.mass_std = float('nan')
        self._body: Array | None = None
        self._window: deque[tuple[bool, bool, Array]] = deque(maxlen=round(_WINDOW / _PERIOD))
        self.pause()

    @property
    def is_loaded(self) -> bool:
        """Whether a payload was found that is still there."""
        return self._body is not None

    def pause(self) -> None:
        """Begin again after a gap; what was found stays."""
        self._columns = self._observed = np.zeros((self._n, 10))
        self._integral: Array | None = None
        self._due = self._quiet = 0.0

    def update(
        self,
        state: ArmState,
        dt: float,
        row: Unexplained,
        threshold: Array,
        base: BaseMotion | None,
    ) -> None:
        """Take a state with what is unexplained of it."""
        self.found = self.released = False
        if not self._is_needed(row, threshold, dt):
            return
        motion = self._still if base is None else base
        momentum, force = self._regressor.evaluate(
            state.q, state.dq, motion.specific_force, motion.angular_velocity
        )
        if self._integral is None:
            self._integral = momentum
        integral = self._integral + dt * -force
        gain = self._gain
        # The same backward Euler steps as in `ExternalTorque`, column by column.
        share = dt * gain / (1.0 + dt * gain)
        self._observed = gain * (momentum - integral) / (1.0 + dt * gain)
        self._integral = integral + dt * self._observed
        self._columns = self._columns + share * (self._observed - self._columns)
        if self._body is not None:
            self.torque = -self._columns @ self._body
        self._due += dt
        if self._due >= _PERIOD:
            self._due = 0.0
            self._learn(state, row, threshold)

    def suspect(self, ratio: Array, threshold: Array) -> None:
        """Look for a payload that came now, unless earlier motion explains the torque.

        Parameters
        ----------
        ratio, threshold : (n,) ndarray
            External torque over its threshold, and the threshold [Nm].
        """
        if self._body is not None:
            return
        predicted = -self._columns @ (self._scale * self._filter.belief.mean) / threshold
        if np.linalg.norm(ratio - predicted) > 0.5 * np.linalg.norm(ratio):
            self._filter.forget(slice(None))
            self._window.clear()

    def _is_needed(self, row: Unexplained, threshold: Array, dt: float) -> bool:
        """Return whether there is torque to explain; the regression is half of all the cost."""
        if self._body is not None or (np.abs(row.residual) > _NOTABLE * threshold).any():
            self._quiet = 0.0
            return True
        self._quiet += dt
        if self._quiet < _WINDOW:
            return True
        if self._integral is not None:
            quiet = self._quiet
            self.pause()
            self._quiet = quiet
        return False

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
        std = float(self._scale[0] * np.sqrt(belief.covariance[0, 0]))
        varied = np.ptp(np.array(predicted), axis=0).max() > 1.0
        if self._body is not None:
            self._body = self._scale * belief.mean
            self.mass, self.mass_std = mass, std
            # The bare arm explains what a payload would have shown in.
            if np.mean(exceeded) < 1.0 - _EXPLAINED and (varied or mass < _SIGNIFICANT * std):
                self._body, self.torque, self.released = None, np.zeros(self._n), True
                self._filter.forget(slice(None))
                self._window.clear()
            return
        if (
            np.mean(exceeded) > _EXCEEDED
            and np.mean(explained) > _EXPLAINED
            and varied
            and mass > _SIGNIFICANT * std
        ):
            self._body, self.found = self._scale * belief.mean, True
            self.mass, self.mass_std = mass, std
