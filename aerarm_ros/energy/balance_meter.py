"""Energy balance of a measured motion, updated with each state."""

import numpy as np

from aerarm_ros.energy.energy_model import EnergyBalance, EnergyModel
from aerarm_ros.motion.signals import ArmState, Array

LONGEST_GAP = 0.1  # [s] largest time between consecutive states


class BalanceMeter:
    """Energy balance of an arm, accumulated from its states.

    A published torque is the mean since the previous state. For each `period` the meter uses the
    mean of these torques, the mean of the velocities at both ends of the period, and the
    acceleration from the difference of both velocities. The work into the motion thus equals the
    change of kinetic energy, and the noise single velocities does not add up.

    Parameters
    ----------
    period : float
        Averaging time of torque and velocity [s]. The noise of single velocities dominates the
        computed dry friction near rest, so 10 ms are better than 1 ms.

    Attributes
    ----------
    total : EnergyBalance
        Energy balance since the start.
    gaps : int
        Number of excluded intervals, in which states or torques were missing.
    """

    def __init__(self, model: EnergyModel, period: float = 0.01) -> None:
        self._model = model
        self._period = period - 0.5e-3  # tolerates jitter of the states
        self.total = EnergyBalance.nothing(model.n)
        self.gaps = 0
        self._begin: tuple[float, ArmState] | None = None
        self._last = 0.0
        # [Nms] time integral of the drive torques since `_begin`
        self._impulse = np.zeros(model.n)
        self._square = np.zeros(model.n)  # [Nm^2 s] time integral of the squared drive torques

    def restart(self) -> None:
        """Discard the last state, so that the next one starts a new interval."""
        self._begin = None

    def add(self, time: float, state: ArmState) -> bool:
        """Process the state at `time` [s]; return whether `total` has changed."""
        if not all(np.isfinite(values).all() for values in state):
            self.gaps += self._begin is not None
            self._begin = None
            return False
        if self._begin is None or not 0.0 < time - self._last <= LONGEST_GAP:
            self.gaps += self._begin is not None and time != self._last
            self._start(time, state)
            return False
        dt, self._last = time - self._last, time
        self._impulse += dt * state.tau
        self._square += dt * state.tau**2
        if time - self._begin[0] < self._period:
            return False
        self._close(time, state)
        return True

    def _start(self, time: float, state: ArmState) -> None:
        self._begin, self._last = (time, state), time
        self._impulse[:] = self._square[:] = 0.0

    def _close(self, time: float, state: ArmState) -> None:
        assert self._begin is not None
        begun, first = self._begin
        dt = time - begun
        q, dq = 0.5 * (first.q + state.q), 0.5 * (first.dq + state.dq)
        model = self._model
        ddq = (state.dq - first.dq) / dt
        rigid = model.dynamics.inverse(q, dq, ddq)
        weight = model.dynamics.gravity(q)
        friction = model.friction_torque(dq, ddq, rigid)
        tau = self._impulse / dt
        rows = (dq, tau, rigid - weight, weight, friction)
        interval = model.split(dt, *(row[np.newaxis] for row in rows))
        # Torque variation within the interval also causes copper loss.
        ripple: Array = model.drives.copper_per_torque2 * (self._square - dt * tau**2)
        interval.copper[:] += ripple
        self.total = self.total + interval
        self._start(time, state)
