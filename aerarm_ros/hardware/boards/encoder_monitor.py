"""Tells when an encoder cannot be believed."""

from math import nan

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_buffer import Array, Mask

_JUMP_VELOCITY_FACTOR = 2.0
_JUMP_ALLOWANCE = 0.05  # [rad] motor side, 33 counts
# A joint at rest stays there while its torque goes from minus to plus its dry friction: twice
# the friction, and as much again because the friction is not known well.
_FRICTION_FACTOR = 4.0
_LOAD_SHARE = 0.1  # a gear's friction grows with the torque that it transmits
# What a joint at rest carries, over gravity's largest share: base and other joints accelerate.
_LOAD_FACTOR = 1.5
_PAUSE = 3e-3  # [s] between two looks: what happened meanwhile proves nothing


class EncoderMonitor:
    """Looks for motor angles that jump, and for angles that stand still against reason.

    A jump is a change faster than twice the joint's velocity limit. A standstill is against
    reason if the angle does not change by a single count although the torque has changed by
    more than dry friction could hold: the encoder is stuck or the joint blocked, which the
    bridge cannot tell apart.

    On a drone the load changes too, and a controller that knows the base's motion holds it
    without moving by a count. So what was commanded as effort is believed, up to the torque
    that a load can ask for; what the boards' feedback adds is not, for it acts only where
    reference and angle differ. Nor does it matter which of the two carries a load that was
    carried before. A joint that the bridge itself brakes is believed to carry what its model says.

    Parameters
    ----------
    config
        Limits, friction and gears.
    stall_time
        How long a standstill against reason is borne [s].
    load_max
        (n,) or one for all: largest torque of gravity [Nm], see `largest_gravity_load`. Zero
        is an arm whose load does not change.

    Attributes
    ----------
    trusted
        (n,) False for the motors whose encoder failed, until `clear`.
    """

    def __init__(self, config: ArmConfig, stall_time: float, load_max: ArrayLike = 0.0) -> None:
        self.trusted: Mask = np.ones(config.n, dtype=bool)
        self._stall_time = stall_time
        fastest = _JUMP_VELOCITY_FACTOR * config.column('velocity_max')
        friction = _FRICTION_FACTOR * config.column('coulomb')
        load = _LOAD_FACTOR * np.broadcast_to(np.asarray(load_max, dtype=float), config.n)
        rows = zip(
            config.joint_names,
            (fastest / config.column('gear.ratio')).tolist(),
            (friction / config.column('torque_per_ampere')).tolist(),
            (load / config.column('torque_per_ampere')).tolist(),
            strict=True,
        )
        self._encoders = [_Encoder(*row) for row in rows]

    def clear(self) -> None:
        """Trust every encoder again, wherever it is now."""
        self.trusted[:] = True
        for encoder in self._encoders:
            encoder.position = nan

    def check(
        self,
        position: Array,
        current: Array,
        fresh: Mask,
        now: float,
        feed_forward: Array | None = None,
        braking_noise: Array | None = None,
    ) -> str:
        """Return what is wrong with an encoder, or ''.

        Parameters
        ----------
        position, current
            (n,) motor side [rad], [A].
        fresh
            (n,) True for motors whose board answered in this cycle.
        now
            Time [s].
        feed_forward
            (n,) the part of the current that was commanded as effort [A]; none if not given.
            Boards answer before they take a command: it is that of the cycle before.
        braking_noise
            (n,) for joints that the bridge brakes itself, the current that counts of the encoder
            make of its torque [A]; 0 for the others, none are braked if not given.
        """
        first = ''
        given = [0.0] * len(self._encoders) if feed_forward is None else feed_forward.tolist()
        noise = [0.0] * len(given) if braking_noise is None else braking_noise.tolist()
        rows = zip(
            self._encoders,
            position.tolist(),
            current.tolist(),
            given,
            noise,
            fresh.tolist(),
            strict=True,
        )
        for i, (encoder, angle, amperes, commanded, noisy, is_fresh) in enumerate(rows):
            if not is_fresh:
                encoder.plausible = now
                continue
            fault = encoder.update(angle, amperes, commanded, noisy, now, self._stall_time)
            if fault:
                self.trusted[i] = False
                first = first or fault
        return first


class _Encoder:
    """What the monitor knows about one motor's encoder; motor side."""

    __slots__ = (
        'fastest',
        'held',
        'load',
        'moving_current',
        'moving_feedback',
        'moving_noise',
        'name',
        'plausible',
        'position',
        'seen',
    )

    def __init__(self, name: str, fastest: float, held: float, load: float) -> None:
        self.name = name
        self.fastest = fastest  # [rad/s]
        self.held = held  # [A] that dry friction may hold
        self.load = load  # [A] that a load may ask for
        self.position = nan  # [rad] NaN compares as no change, so no jump, after clear
        self.seen = 0.0
        self.moving_current = 0.0  # [A] when the angle last changed
        self.moving_feedback = 0.0  # [A] part of it that was not commanded as effort
        self.moving_noise = 0.0  # [A] of it, if the joint was braked
        self.plausible = 0.0

    def update(
        self,
        position: float,
        current: float,
        commanded: float,
        noise: float,
        now: float,
        stall_time: float,
    ) -> str:
        """Take an angle [rad] and currents [A]; return what is wrong, or ''."""
        change = abs(position - self.position)
        elapsed = now - self.seen
        jumped = change > self.fastest * elapsed + _JUMP_ALLOWANCE
        self.position, self.seen = position, now
        if jumped:
            return (
                f'the encoder of {self.name} jumped by {change:.2f} rad (motor side): '
                'check its cable and mounting, then home the arm'
            )
        feedback = current - commanded
        if change != 0.0:
            self.moving_current, self.moving_feedback = current, feedback
            self.moving_noise = noise
        held = self.held + _LOAD_SHARE * abs(current) + max(noise, self.moving_noise)
        unexplained = abs(current - self.moving_current)
        if noise or abs(current) <= self.load:
            unexplained = min(unexplained, abs(feedback - self.moving_feedback))
        if unexplained <= held or elapsed > _PAUSE:
            self.plausible = now
        elif now - self.plausible > stall_time:
            return (
                f'{self.name} does not move although its current changed to '
                f'{current:.1f} A: check for a stuck encoder or a blocked joint'
            )
        return ''
