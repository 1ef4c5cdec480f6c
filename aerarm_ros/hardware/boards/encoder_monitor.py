"""Detect implausible encoder readings."""

from collections.abc import Sequence
from math import copysign, inf, nan

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_intake import Mask
from aerarm_ros.motion.signals import Array

# Motion counts once a joint must have turned by this much [rad]: 90 counts of its encoder.
_CLEARLY = 5e-3
_LOOKS_MIN = 3  # that saw no motion; a frame that comes twice is one
# A motor near its limit may lack what friction takes; but nothing holds it there for so long [s].
_STRAINED_SHARE = 0.9
_STRAINED_MAX = 0.1
# What a look finds wrong corrects the speed [1/s], and the load [1/s^2]: known within 10 ms.
_SPEED_RATE = 200.0
_LOAD_RATE = 15e3
_LOOKED = 4e-3  # [s]; a longer interval corrects no more
_COUNTS = 3e-3  # [rad, motor side] two counts: the error of an angle's change, ...
_SHORTEST = 1e-4  # [s] ... and the time that it took at least
# In a second a load changes by twice what the joint may carry: the base turns, the arm too.
_LOAD_TURNS = 2.0


class ExpectedMotion:
    """Follows the load of a motor that is seen to move, and its motion once it is seen to stand.

    Nothing about the arm's weight is believed but what the motion tells: the torque that did not
    accelerate the motor is its load, with any payload, on a base turned any way. While the angle
    stands, a motor with that load and with more friction than any is led by its current. Its
    speed does not end between two looks, and torque beyond the load accelerates it; so if it had
    to turn clearly and its angle has not changed by a count, the angle is wrong, or the joint is
    blocked. So it is if the motor's whole current does not change it by a count for a time.

    A motor that creeps tells a count in some looks and none in others. Both are learnt from: by
    those that tell one alone it is faster than it is, and its load would fall and fall.

    On the side of rest: a load that the motor gives way to may be carried by something else, a
    changing load may be what the current changes for, and nobody saw what happened in a pause.

    Motor side; plain numbers, not arrays: for four joints that is faster.

    Parameters
    ----------
    load_max
        Current that load and friction may ask for [A].
    current_max
        The motor's limit [A].
    torque_per_ampere, ratio
        Of the joint [Nm/A], and its speed over the motor's.
    """

    __slots__ = (
        '_clearly',
        '_current',
        '_impulse',
        '_is_followed',
        '_load',
        '_looks',
        '_modelled',
        '_moved',
        '_per_inertia',
        '_rate',
        '_seen_speed',
        '_speed',
        '_stood',
        '_strained',
        '_strong',
        '_turned',
    )

    def __init__(
        self, load_max: float, current_max: float, torque_per_ampere: float, ratio: float
    ) -> None:
        self._strong = _STRAINED_SHARE * current_max
        self._rate = _LOAD_TURNS * load_max
        self._per_inertia = torque_per_ampere / ratio
        self._clearly = _CLEARLY / ratio
        self._load = self._current = self._modelled = nan
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        self._moved = self._impulse = 0.0  # [rad/s] when its angle last changed, [A s] since
        self._looks = 0
        self._is_followed = True

    def restart(self) -> None:
        """Reset the estimate: the motor rests, and its present current is its load."""
        self._load = self._current = self._modelled = nan
        self._rest()

    def update(
        self,
        change: float,
        elapsed: float,
        current: float,
        inertia: float,
        friction: float,
        modelled: float = 0.0,
    ) -> bool:
        """Take a look; return whether it must have turned clearly since its angle last changed.

        Parameters
        ----------
        change
            Of the angle since the last look [rad].
        elapsed
            Time since then [s].
        current
            [A].
        inertia
            Of the joint [kg m^2].
        friction
            Current that may hold the motor [A].
        modelled
            Its load as the arm's model has it [A]. Only changes count, and they only widen what
            the load may be: other joints that push against something accelerate in the model.
        """
        if self._load != self._load:
            self._load, self._modelled = current, modelled
        gain = self._per_inertia / inertia  # [rad/s^2 / A]
        if change != 0.0:
            self._see(change, elapsed, current, gain)
            self._modelled = modelled
            return False
        if not self._looks:
            self._begin(elapsed, gain)
        self._looks += 1
        self._stood += elapsed
        self._impulse += current * elapsed
        self._current = current
        drive = abs(current - self._load)
        if self._speed == 0.0 and drive <= friction and abs(current) <= self._strong:
            # Most joints rest most of the time.
            self._turned = self._strained = 0.0
            self._follow(current, elapsed)
            return False
        self._lead(elapsed, current, gain, friction + abs(modelled - self._modelled))
        self._strained = self._strained + elapsed if abs(current) > self._strong else 0.0
        if self._strained > _STRAINED_MAX:
            return True
        return self._looks >= _LOOKS_MIN and abs(self._turned) > self._clearly

    def pause(self, change: float, elapsed: float, current: float) -> None:
        """Take a look after a time [s] in which nobody saw what the current did; as `update`.

        Whatever the speed was, it may be gone. But what stood before and stands now has stood.
        """
        if change != 0.0 or not self._looks:
            self._rest()
        self._is_followed = False
        self._follow(current, elapsed)

    def _rest(self) -> None:
        self._moved = self._impulse = 0.0
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _see(self, change: float, elapsed: float, current: float, gain: float) -> None:
        """Take an angle that has changed: by what the current did not do, correct the load."""
        impulse = self._impulse + current * elapsed
        elapsed += self._stood
        seen = change / elapsed
        if not self._is_followed or (self._stood and elapsed > _LOOKED):
            self._speed = seen  # a mean over more than is known of the currents
        else:
            predicted = self._moved + (impulse - self._load * elapsed) * gain
            wrong = seen - predicted
            looked = min(elapsed, _LOOKED)
            self._speed = predicted + _SPEED_RATE * looked * wrong
            self._load -= _LOAD_RATE * looked * wrong / gain
        self._seen_speed, self._current = seen, current
        self._moved, self._impulse = self._speed, 0.0
        self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _begin(self, elapsed: float, gain: float) -> None:
        """Find the least speed that it can have had at the end of the last look's motion."""
        seen, way = self._seen_speed, copysign(1.0, self._seen_speed)
        speed = min(abs(seen), max(way * self._speed, 0.0))
        speed -= _COUNTS / max(elapsed, _SHORTEST)
        # The look told of the mean: the torque that braked it has led it on.
        braked = min(way * (self._current - self._load), 0.0) * gain * 0.5 * elapsed
        self._speed = way * max(speed + braked, 0.0)
        self._seen_speed = self._turned = 0.0

    def _lead(self, elapsed: float, current: float, gain: float, friction: float) -> None:
        """Lead the motor on by the least that its current must do."""
        load, speed = self._load, self._speed
        # Something else may carry a load that the motor gives way to.
        carried = min(max(current, min(load, 0.0)), max(load, 0.0))
        drive = current - carried
        if speed != 0.0:
            way = copysign(1.0, speed)
            pulled = min(way * drive, way * (current - load)) - friction
            after = speed + way * pulled * gain * elapsed
            after = after if after * speed > 0.0 else 0.0
        else:
            excess = max(abs(drive) - friction, 0.0)
            after = copysign(excess * gain * elapsed, drive)
        self._turned = self._turned + 0.5 * (speed + after) * elapsed if after else 0.0
        self._speed = after
        self._follow(current, elapsed)

    def _follow(self, current: float, elapsed: float) -> None:
        """Let the load be what the current changes for, as fast as a load may change."""
        step = self._rate * elapsed
        self._load += min(max(current - self._load, -step), step)


_JUMP_VELOCITY_FACTOR = 2.0
_JUMP_ALLOWANCE = 0.05  # [rad] motor side, 33 counts
_JUMPS_MAX = 2  # that may each have been one wrong reading
# A joint at rest stays there while its torque goes from minus to plus its dry friction: twice
# the friction, and as much again because the friction is not known well.
_FRICTION_FACTOR = 4.0
_LOAD_SHARE = 0.2  # a gear's friction grows by a tenth of the torque that it transmits, either way
# What a joint at rest carries, over gravity's largest share: base and other joints accelerate
# (decision 19).
_LOAD_FACTOR = 1.5
# Over the speed before a jump: a joint may brake harder, and a count more or less is a speed too.
_SPEED_FACTOR = 1.5
_SPEED_ALLOWANCE = 5.0  # [rad/s]
_PAUSE = 3e-3  # [s] between two looks: what the current did meanwhile, nobody saw


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

    A torque that stays the same moves a joint as well: a standstill is also against reason once the
    joint must have turned clearly; see `ExpectedMotion`.

    One look stops the arm. But a joint that is no longer damped by its encoder's speed is let go,
    so a second look comes before that: is the angle still where no motion could have brought it,
    is it still standing? If not, the joint goes on being damped. Between the two looks at a jump
    it is damped as far as the speed before the jump asks for: what the board makes of a jump is
    a speed that would drive it.

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
        (n,) False for the motors whose encoder is doubted, until `clear`.
    tells_position
        (n,) False for the motors whose encoder has jumped, or stands against reason; one that moves
        on was not stuck: a load that changed as its current did may hold a joint still.
    damping_speed
        (n,) speeds [rad/s, motor side] up to which damping may believe the encoders: inf for
        any, 0 for none.
    """

    def __init__(self, config: ArmConfig, stall_time: float, load_max: ArrayLike = 0.0) -> None:
        self.trusted: Mask = np.ones(config.n, dtype=bool)
        self.tells_position: Mask = np.ones(config.n, dtype=bool)
        self.damping_speed: Array = np.full(config.n, inf)
        self._stall_time = stall_time
        fastest = _JUMP_VELOCITY_FACTOR * config.column('velocity_max')
        friction = _FRICTION_FACTOR * config.column('coulomb')
        strongest = config.column('effort_max') / config.column('torque_per_ampere')
        load = _LOAD_FACTOR * np.broadcast_to(np.asarray(load_max, dtype=float), config.n)
        rows = zip(
            config.joint_names,
            (fastest / config.column('gear.ratio')).tolist(),
            (friction / config.column('torque_per_ampere')).tolist(),
            (load / config.column('torque_per_ampere')).tolist(),
            np.minimum(strongest, config.column('motor.current_max')).tolist(),
            config.column('torque_per_ampere').tolist(),
            config.column('gear.ratio').tolist(),
            strict=True,
        )
        self._encoders = [_Encoder(*row) for row in rows]

    def clear(self) -> None:
        """Trust every encoder again, wherever it is now."""
        self.trusted[:] = self.tells_position[:] = True
        self.damping_speed[:] = inf
        for encoder in self._encoders:
            encoder.clear()

    @property
    def lost(self) -> list[int]:
        """Joints whose count is known to be wrong: it stays where it jumped to, or stood still."""
        return [number for number, encoder in enumerate(self._encoders) if encoder.is_lost]

    def check(
        self,
        position: Array,
        current: Array,
        fresh: Mask,
        now: float,
        feed_forward: Sequence[float] | None = None,
        braking_noise: Sequence[float] | None = None,
        interval_max: Array | None = None,
        inertias: Sequence[float] | None = None,
        loads: Sequence[float] | None = None,
    ) -> str:
        """Return the fault of an encoder, or ''.

        Parameters
        ----------
        position, current
            (n,) motor side [rad], [A].
        fresh
            (n,) True for motors whose board answered in this cycle.
        now
            Time [s].
        feed_forward
            n, the part of the current that was commanded as effort [A]; none if not given.
            Boards answer before they take a command: it is that of the cycle before.
        braking_noise
            n, for joints that the bridge brakes itself, the current that counts of the encoder
            make of its torque [A]; 0 for the others, none are braked if not given.
        interval_max
            (n,) longest time that the angles can have taken to change since the last look [s];
            the difference of `now` if not given, which a host held up makes too small.
        inertias, loads
            n each, of the joints [kg m^2] and, as the arm's model has them, [Nm]; without them it
            is not asked whether a joint must have turned.
        """
        n = len(self._encoders)
        given = [0.0] * n if feed_forward is None else feed_forward
        noise = [0.0] * n if braking_noise is None else braking_noise
        if interval_max is None:
            intervals = [now - encoder.seen for encoder in self._encoders]
        else:
            intervals = interval_max.tolist()
        first = ''
        for i, encoder, angle, amps, commanded, noisy, is_fresh, interval, inertia, load in zip(
            range(n),
            self._encoders,
            position.tolist(),
            current.tolist(),
            given,
            noise,
            fresh.tolist(),
            intervals,
            inertias or [nan] * n,
            loads or [0.0] * n,
            strict=True,
        ):
            if not is_fresh:
                continue
            jump = encoder.look(angle, now, interval)
            stand = encoder.feel(amps, commanded, noisy, self._stall_time)
            fault = jump or stand or encoder.expect(amps, noisy, inertia, load)
            if fault:
                self.trusted[i] = False
                first = first or fault
            if not self.trusted[i]:
                self.tells_position[i] = encoder.tells_position
                self.damping_speed[i] = encoder.damping_speed
        return first


class _Encoder:
    """What the monitor knows about one motor's encoder; motor side."""

    # The first look finds a change (of NaN), which sets all that `feel` reads.
    __slots__ = (
        'anchor',  # [rad] before a jump that awaits its second look, NaN without one
        'change',  # [rad] since the look before
        'doubted_for',  # [s] of a standstill that awaits its second look, NaN without one
        'elapsed',  # [s] since the look before
        'expected',  # motion
        'fastest',  # [rad/s]
        'held',  # [A] that dry friction may hold
        'has_jumped',  # and did not come back
        'is_confirmed',
        'is_pause',
        'is_settling',  # the last look saw it move
        'jumps',
        'load',  # [A] that a load may ask for
        'model_scale',  # [A/Nm]
        'moving_current',  # [A] when the angle last changed, or just after
        'moving_feedback',  # [A] part of it that was not commanded as effort
        'moving_noise',  # [A] of it, if the joint was braked
        'name',
        'position',  # [rad]
        'seen',  # [s] when
        'since_anchor',  # [s]
        'speed',  # [rad/s] without sign, of the last look that was no jump
        'standing',  # [s] against reason
        'stood_at',  # [rad] where it was doubted for that, NaN once it has moved on
    )

    def __init__(
        self,
        name: str,
        fastest: float,
        held: float,
        load: float,
        strongest: float,
        torque_per_ampere: float,
        ratio: float,
    ) -> None:
        self.name = name
        self.fastest = fastest
        self.held = held
        self.load = load
        self.expected = ExpectedMotion(load + held, strongest, torque_per_ampere, ratio)
        self.model_scale = 1.0 / torque_per_ampere
        self.seen = 0.0
        self.clear()

    def clear(self) -> None:
        """Trust it, wherever it is now."""
        self.position = self.anchor = nan  # compares as no change, so no jump
        self.stood_at = nan
        self.jumps = 0
        self.has_jumped = self.is_confirmed = False
        self.expected.restart()

    @property
    def tells_position(self) -> bool:
        """Whether the joint position is known."""
        return not self.jumps and self.stood_at != self.stood_at

    @property
    def is_lost(self) -> bool:
        """Whether its count is known to be wrong."""
        return self.has_jumped or self.is_confirmed

    @property
    def damping_speed(self) -> float:
        """Speed up to which damping may use the encoder [rad/s]."""
        if self.is_confirmed:
            return 0.0
        if self.anchor == self.anchor:
            return _SPEED_FACTOR * self.speed + _SPEED_ALLOWANCE
        return inf

    def look(self, position: float, now: float, interval: float) -> str:
        """Take an angle [rad] at a time, and the longest it can have changed for [s]."""
        jump = self._jump(position, interval)
        self.change = position - self.position
        self.elapsed, self.is_pause = min(now - self.seen, interval), interval > _PAUSE
        self.position, self.seen = position, now
        return jump

    def _jump(self, position: float, interval: float) -> str:
        doubted = self.anchor == self.anchor
        # The second look compares with the angle before the jump, wherever that led.
        before = self.anchor if doubted else self.position
        time = self.since_anchor + interval if doubted else interval
        change = abs(position - before)
        self.anchor = nan
        if not change > self.fastest * time + _JUMP_ALLOWANCE:
            if doubted and change > self._slowly(time):
                self.has_jumped = True
            is_known = change == change and time > 0.0  # not the first look
            self.speed = change / time if is_known else 0.0
            return ''
        self.jumps += 1
        if doubted or self.jumps > _JUMPS_MAX:
            self.is_confirmed = True
        else:
            self.anchor = before
            self.since_anchor: float = interval
        return (
            f'the encoder of {self.name} jumped by {change:.2f} rad (motor side): '
            'check its cable and mounting, then home the arm'
        )

    def _slowly(self, time: float) -> float:
        """Return how far the speed before a jump may bring it in a time [s]."""
        return (_SPEED_FACTOR * self.speed + _SPEED_ALLOWANCE) * time + _JUMP_ALLOWANCE

    def feel(self, current: float, commanded: float, noise: float, stall_time: float) -> str:
        """Take the currents [A] at the last look; return why it may not stand still, or ''."""
        feedback = current - commanded
        if self.change != 0.0:
            self.moving_current, self.moving_feedback = current, feedback
            self.moving_noise = noise
            self.doubted_for = nan
            self.is_settling = True
            if abs(self.position - self.stood_at) > _JUMP_ALLOWANCE and not self.is_confirmed:
                self.stood_at = nan
        elif self.is_pause:
            return ''
        elif self.is_settling:
            # The last look may have seen the current that braked it, which is gone at rest.
            self.is_settling = False
            if abs(current) < abs(self.moving_current):
                self.moving_current, self.moving_feedback = current, feedback
        self.doubted_for += self.elapsed
        if self.doubted_for > stall_time:
            self.is_confirmed = True
        held = self.held + _LOAD_SHARE * abs(current) + max(noise, self.moving_noise)
        unexplained = abs(current - self.moving_current)
        if noise or abs(current) <= self.load:
            unexplained = min(unexplained, abs(feedback - self.moving_feedback))
        if unexplained <= held:
            self.standing = 0.0
            return ''
        self.standing += self.elapsed
        if self.standing <= stall_time:
            return ''
        self._doubt()
        return (
            f'{self.name} does not move although its current changed to '
            f'{current:.1f} A: check for a stuck encoder or a blocked joint'
        )

    def expect(self, current: float, noise: float, inertia: float, load: float) -> str:
        """Take what the joint moves [kg m^2] and carries [Nm]; return why it must have moved.

        To be called after `feel`, with the same currents [A]; NaN is an inertia nobody knows.
        """
        if inertia != inertia:
            return ''
        if self.anchor == self.anchor or self.change != self.change:
            self.expected.restart()
            return ''
        if self.is_pause:
            self.expected.pause(self.change, self.elapsed, current)
            return ''
        friction = self.held + _LOAD_SHARE * abs(current) + noise
        modelled = self.model_scale * load
        if not self.expected.update(
            self.change, self.elapsed, current, inertia, friction, modelled
        ):
            return ''
        self._doubt()
        return (
            f'{self.name} does not move although its speed and its current of {current:.1f} A '
            'must have turned it: check for a stuck encoder or a blocked joint'
        )

    def _doubt(self) -> None:
        """Begin to wait for the second look at a standstill."""
        if self.doubted_for != self.doubted_for:
            self.doubted_for = 0.0
            self.stood_at = self.position
