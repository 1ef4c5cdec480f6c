"""Tells when an encoder cannot be believed."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.joint_command import Array, Mask

_JUMP_VELOCITY_FACTOR = 2.0
_JUMP_ALLOWANCE = 0.05  # [rad] motor side, 33 counts
# A joint at rest stays there while its torque goes from minus to plus its dry friction: twice
# the friction, and as much again because the friction is not known well.
_FRICTION_FACTOR = 4.0
_LOAD_SHARE = 0.1  # a gear's friction grows with the torque that it transmits


class EncoderMonitor:
    """Looks for motor angles that jump, and for angles that stand still against reason.

    A jump is a change faster than twice the joint's velocity limit. A standstill is against
    reason if the angle does not change by a single count although the torque has changed by
    more than dry friction could hold: the encoder is stuck or the joint blocked, which the
    bridge cannot tell apart.

    Parameters
    ----------
    config
        Limits, friction and gears.
    stall_time
        How long a standstill against reason is borne [s].

    Attributes
    ----------
    trusted
        (n,) False for the motors whose encoder failed, until `clear`.
    """

    def __init__(self, config: ArmConfig, stall_time: float) -> None:
        self.trusted: Mask = np.ones(config.n, dtype=bool)
        self._names = config.joint_names
        fastest = config.column('velocity_max') / config.column('gear.ratio')
        self._fastest = _JUMP_VELOCITY_FACTOR * fastest
        friction = config.column('coulomb') / config.column('torque_per_ampere')
        self._held_current = _FRICTION_FACTOR * friction
        self._stall_time = stall_time
        self._position: Array = np.full(config.n, np.nan)
        self._seen = np.zeros(config.n)
        self._moving_current = np.zeros(config.n)
        self._plausible = np.zeros(config.n)

    def clear(self) -> None:
        """Trust every encoder again, wherever it is now."""
        self.trusted[:] = True
        self._position[:] = np.nan

    def check(self, position: Array, current: Array, fresh: Mask, now: float) -> str:
        """Return what is wrong with an encoder, or ''.

        Parameters
        ----------
        position, current
            (n,) motor side [rad], [A].
        fresh
            (n,) True for motors whose board answered in this cycle.
        now
            Time [s].
        """
        change = np.abs(position - self._position)  # NaN, so no jump, after clear
        jumped = fresh & (change > self._fastest * (now - self._seen) + _JUMP_ALLOWANCE)
        stalled = self._stalled(change, current, fresh, now)
        np.copyto(self._position, position, where=fresh)
        np.copyto(self._seen, now, where=fresh)
        if jumped.any():
            i = int(np.argmax(jumped))
            self.trusted[jumped] = False
            return (
                f'the encoder of {self._names[i]} jumped by {change[i]:.2f} rad (motor side): '
                'check its cable and mounting, then home the arm'
            )
        if stalled.any():
            i = int(np.argmax(stalled))
            self.trusted[stalled] = False
            return (
                f'{self._names[i]} does not move although its current changed to '
                f'{current[i]:.1f} A: check for a stuck encoder or a blocked joint'
            )
        return ''

    def _stalled(self, change: Array, current: Array, fresh: Mask, now: float) -> Mask:
        """Tell which joints (n,) have stood still against reason for too long."""
        np.copyto(self._moving_current, current, where=change != 0.0)
        held = self._held_current + _LOAD_SHARE * np.abs(current)
        plausible = np.abs(current - self._moving_current) <= held
        np.copyto(self._plausible, now, where=plausible | ~fresh)
        return np.asarray(now - self._plausible > self._stall_time)
