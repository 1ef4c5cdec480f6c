"""Where the energy of a measured motion goes, state by state."""

import numpy as np

from aerarm_ros.energy.energy_model import EnergyBalance, EnergyModel
from aerarm_ros.motion.signals import ArmState, Array

LONGEST_GAP = 0.1  # [s] states further apart are not neighbours


class BalanceMeter:
    """Adds up the balance of an arm from its states.

    A published torque is the mean since the state before. Over each `period` the mean of these
    torques acts, in a motion whose velocity is the mean of that at both ends and whose acceleration
    is their difference: so work into the motion is the kinetic energy's change, and the noise of
    single velocities does not add up.

    Parameters
    ----------
    model : EnergyModel
    period : float
        Time over which torque and velocity are taken as one [s]. The noise of single velocities
        is much of what dry friction about rest is computed from: 10 ms are better than one.

    Attributes
    ----------
    total : EnergyBalance
        So far.
    gaps : int
        How often states were too far apart, or had no torque: their time is left out.
    """

    def __init__(self, model: EnergyModel, period: float = 0.01) -> None:
        self._model = model
        self._period = period - 0.5e-3  # states come with jitter
        self.total = EnergyBalance.nothing(model.n)
        self.gaps = 0
        self._begin: tuple[float, ArmState] | None = None
        self._last = 0.0
        self._impulse = np.zeros(model.n)  # [Nms] of the torque since `_begin`
        self._square = np.zeros(model.n)  # [Nm^2 s]

    def restart(self) -> None:
        """Forget the last state: the next one is not its neighbour."""
        self._begin = None

    def add(self, time: float, state: ArmState) -> bool:
        """Take the state at `time` [s]; return whether `total` has changed."""
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
        # What varies within the interval heats, too.
        ripple: Array = model.drives.copper_per_torque2 * (self._square - dt * tau**2)
        interval.copper[:] += ripple
        self.total = self.total + interval
        self._start(time, state)
