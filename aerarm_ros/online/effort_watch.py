"""Whether torques are measured at all."""

import numpy as np

from aerarm_ros.motion.arm_state import ArmState

_FROZEN = 0.2  # [s] in which a measured torque of a moving joint changes
_MOVING = 0.05  # [rad/s]


class EffortWatch:
    """Looks for joints that move while their torque stays the same to the last bit.

    Parameters
    ----------
    names : tuple of str
        Of the joints.

    Attributes
    ----------
    problem : str
        What is wrong, '' if nothing.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._before = np.full(len(names), np.nan)
        self._same = np.zeros(len(names))
        self.problem = ''

    def update(self, state: ArmState, dt: float) -> None:
        """Take a state, `dt` [s] after the one before."""
        is_same = state.tau == self._before
        self._before = np.array(state.tau)
        if not is_same.any() and not self.problem:
            self._same[:] = 0.0
            return
        self._same = np.where(is_same, self._same + dt * (np.abs(state.dq) > _MOVING), 0.0)
        frozen = np.flatnonzero(self._same > _FROZEN)
        self.problem = ''
        if len(frozen):
            names = ', '.join(self._names[index] for index in frozen)
            self.problem = (
                f'effort of {names} stays {state.tau[frozen[0]]:.3g} Nm while it moves: check that '
                'joint_states has measured torques'
            )
