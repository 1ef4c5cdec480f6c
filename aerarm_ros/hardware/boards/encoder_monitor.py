"""Detection of implausible motor encoder readings: jumps, and no motion despite torque."""

from collections.abc import Sequence
from math import copysign, inf, nan

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_intake import Mask
from aerarm_ros.motion.signals import Array

# A standstill is a fault once the motor must have turned by this angle [rad], 90 encoder counts.
_CLEARLY = 5e-3
# number of consecutive checks without motion, at least two because a frame may arrive twice
_LOOKS_MIN = 3
# A motor at its current limit may not overcome friction, but no load holds it still for longer
# than this time [s].
_STRAINED_SHARE = 0.9
_STRAINED_MAX = 0.1
# Observer gains that correct the speed [1/s] and the load [1/s^2]; they settle within 10 ms.
_SPEED_RATE = 200.0
_LOAD_RATE = 15e3
_LOOKED = 4e-3  # [s] intervals longer than this give no larger correction
_COUNTS = 3e-3  # [rad, motor side] two counts: the error of an angle change, ...
_SHORTEST = 1e-4  # [s] ... and the shortest time that the change can take
# A load changes by at most twice the joint's largest load per second, as base and arm turn.
_LOAD_TURNS = 2.0


class ExpectedMotion:
    """Estimates a motor's load, and the least motion that the motor current must have caused.

    The estimate uses no model of the arm's weight. The torque that does not accelerate the motor is
    its load, which includes any payload and any base orientation. While the measured angle does
    not change, the motor's minimum motion is predicted from its current, the estimated load and
    an upper bound of friction. If this motion is large although the angle has not changed by one
    count, the encoder is wrong or the joint is blocked. The encoder is also judged wrong, or the
    joint blocked, if the full motor current does not change the angle for some time.

    The angle of a slow motor changes by one count in some checks and not at all in others. Both
    kinds of checks update the estimate; changes of the angle alone would overestimate the speed
    and falsify the load.

    The estimate assumes rest in three cases: an external force may hold a load to which the motor
    yields, a changing load may explain a changing current, or the motion was not observed during
    a pause.

    All quantities refer to the motor side. Plain floats are used, because they are faster than
    arrays for four joints.

    Parameters
    ----------
    load_max
        Largest current that load and friction can require [A].
    current_max
        Current limit of the motor [A].
    torque_per_ampere, ratio
        Joint torque per motor current [Nm/A], and joint speed over motor speed.
    """

    def __init__(
        self, load_max: float, current_max: float, torque_per_ampere: float, ratio: float
    ) -> None:
        self._strong = _STRAINED_SHARE * current_max
        self._rate = _LOAD_TURNS * load_max
        self._per_inertia = torque_per_ampere / ratio
        self._clearly = _CLEARLY / ratio
        self._load = self._current = self._modelled = nan
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        # [rad/s] speed at the last change of angle, and [A s] time integral of the excess current
        # since then
        self._moved = self._impulse = 0.0
        self._looks = 0
        self._is_followed = True

    def restart(self) -> None:
        """Restart, assuming that the motor rests and that its present current holds the load."""
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
        """Process a measurement; return whether an unchanged angle contradicts the current.

        Parameters
        ----------
        change
            Change of the angle since the last check [rad].
        elapsed
            Time since the last check [s].
        current
            Motor current [A].
        inertia
            Inertia of the joint [kg m^2].
        friction
            Current that friction can hold [A].
        modelled
            Load computed with the arm's model [A]. The model ignores contacts, so only changes of
            this load are used, to widen the range of possible loads.
        """
        if self._load != self._load:
            self._load, self._modelled = current, modelled
        gain = self._per_inertia / inertia  # [rad/s^2 / A]
        if change != 0.0:
            self._process_change(change, elapsed, current, gain)
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
            # Return early, because most joints are at rest most of the time.
            self._turned = self._strained = 0.0
            self._adapt_load(current, elapsed)
            return False
        self._predict(elapsed, current, gain, friction + abs(modelled - self._modelled))
        self._strained = self._strained + elapsed if abs(current) > self._strong else 0.0
        if self._strained > _STRAINED_MAX:
            return True
        return self._looks >= _LOOKS_MIN and abs(self._turned) > self._clearly

    def pause(self, change: float, elapsed: float, current: float) -> None:
        """Process a measurement after a pause in which the motor current was not measured.

        The motor's speed is unknown after the pause, but a motor that stood still before and
        after it counts as standing.
        """
        if change != 0.0 or not self._looks:
            self._rest()
        self._is_followed = False
        self._adapt_load(current, elapsed)

    def _rest(self) -> None:
        self._moved = self._impulse = 0.0
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _process_change(self, change: float, elapsed: float, current: float, gain: float) -> None:
        """Process a changed angle: correct the estimates of speed and load."""
        impulse = self._impulse + current * elapsed
        elapsed += self._stood
        seen = change / elapsed
        if not self._is_followed or (self._stood and elapsed > _LOOKED):
            # the angle change is a mean over a longer time than that of the known currents
            self._speed = seen
        else:
            predicted = self._moved + (impulse - self._load * elapsed) * gain
            wrong = seen - predicted
            looked = _LOOKED if elapsed > _LOOKED else elapsed
            self._speed = predicted + _SPEED_RATE * looked * wrong
            self._load -= _LOAD_RATE * looked * wrong / gain
        self._seen_speed, self._current = seen, current
        self._moved, self._impulse = self._speed, 0.0
        self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _begin(self, elapsed: float, gain: float) -> None:
        """Compute the least speed that the motor can have had when its angle last changed."""
        seen, way = self._seen_speed, copysign(1.0, self._seen_speed)
        speed = min(abs(seen), max(way * self._speed, 0.0))
        speed -= _COUNTS / max(elapsed, _SHORTEST)
        # The observed motion gives a mean speed; a braking torque made the final speed lower.
        braked = min(way * (self._current - self._load), 0.0) * gain * 0.5 * elapsed
        self._speed = way * max(speed + braked, 0.0)
        self._seen_speed = self._turned = 0.0

    def _predict(self, elapsed: float, current: float, gain: float, friction: float) -> None:
        """Predict the least motion that the motor current must cause."""
        load, speed = self._load, self._speed
        # An external force may hold a load to which the motor yields.
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
        self._adapt_load(current, elapsed)

    def _adapt_load(self, current: float, elapsed: float) -> None:
        """Move the load estimate towards the motor current, no faster than real loads change."""
        step = self._rate * elapsed
        change = current - self._load
        self._load += -step if change < -step else step if change > step else change


_JUMP_VELOCITY_FACTOR = 2.0
_JUMP_ALLOWANCE = 0.05  # [rad] motor side, 33 counts
_JUMPS_MAX = 2  # number of jumps that may each be a single wrong reading
# A joint at rest stays at rest while its torque changes by up to twice its dry friction. The
# factor is doubled again, because friction is not known well.
_FRICTION_FACTOR = 4.0
# gear friction grows with a tenth of the transmitted torque, in both directions of motion
_LOAD_SHARE = 0.2
# Largest load of a joint at rest, relative to its largest gravity load; it exceeds 1 because base
# and other joints accelerate (decision 19).
_LOAD_FACTOR = 1.5
# Largest speed assumed after a jump, relative to the speed before the jump: the joint may brake
# harder, and one count adds speed.
_SPEED_FACTOR = 1.5
_SPEED_ALLOWANCE = 5.0  # [rad/s]
_PAUSE = 3e-3  # [s] longest time between two checks for which the current between them is known


class EncoderMonitor:
    """Detects encoders whose angle jumps, or stays constant although the motor must have turned.

    A jump is a change faster than twice the joint's velocity limit. A standstill of an angle is
    implausible if the angle does not change by one count although the torque has changed by more
    than dry friction can hold. Either the encoder is stuck or the joint is blocked; the bridge
    cannot distinguish them.

    On a drone the load changes with the base motion, and a controller that knows this motion can
    hold the joint without moving it by a count. Effort commands are therefore accepted as load, up
    to the largest possible load torque. Current from the boards' position feedback is not
    accepted as load, because a difference between reference and angle causes it. For a joint that
    the bridge brakes, the load is computed with the model.

    A standstill under a constant torque is also implausible once this torque must have turned the
    joint; see `ExpectedMotion`.

    One implausible reading stops the arm and damps its joints. The damping of the joint itself
    ends only if a second reading confirms the fault, because a joint without damping falls. The
    board sees a jump as a speed, so its damping would drive the joint. Between the two readings,
    damping is therefore limited to the speed before the jump.

    Parameters
    ----------
    config
        Configuration with limits, friction and gears.
    stall_time
        Tolerated duration of an implausible standstill [s].
    load_max
        (n,) or one for all: largest gravity torque [Nm], see `largest_gravity_load`. Zero means
        that the load never changes.

    Attributes
    ----------
    trusted
        (n,) False for motors whose encoder had an implausible reading, until `clear`.
    has_doubts
        Whether `trusted` is False for any motor.
    is_position_reliable
        (n,) False for motors whose encoder has jumped or stands still implausibly. The flag is
        True again once the angle changes, because a changing load may have held the motor still.
    damping_speed
        (n,) largest motor speeds [rad/s] for which a board may damp its motor: inf for no limit,
        0 for no damping.
    """

    def __init__(self, config: ArmConfig, stall_time: float, load_max: ArrayLike = 0.0) -> None:
        self.trusted: Mask = np.ones(config.n, dtype=bool)
        self.has_doubts = False
        self.is_position_reliable: Mask = np.ones(config.n, dtype=bool)
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
        """Clear the faults of all encoders; monitoring starts at their present angles."""
        self.trusted[:] = self.is_position_reliable[:] = True
        self.has_doubts = False
        self.damping_speed[:] = inf
        for encoder in self._encoders:
            encoder.clear()

    @property
    def lost(self) -> list[int]:
        """Numbers of the joints whose encoder count is wrong after a jump or standstill."""
        return [number for number, encoder in enumerate(self._encoders) if encoder.is_lost]

    def check(
        self,
        position: Array,
        current: Array,
        fresh: Sequence[bool],
        now: float,
        feed_forward: Sequence[float],
        braking_noise: Sequence[float],
        interval_max: Sequence[float],
        inertias: Sequence[float],
        loads: Sequence[float],
    ) -> str:
        """Check the encoders of all motors; return a description of a fault, '' without one.

        Parameters
        ----------
        position, current
            (n,) motor angles [rad] and currents [A].
        fresh
            n flags, True for motors whose board answered in this cycle.
        now
            Time [s].
        feed_forward
            n motor currents commanded as effort in the previous cycle [A]; boards answer before
            they read a command.
        braking_noise
            n motor currents caused by encoder quantization in joints that the bridge brakes [A];
            0 for all other joints.
        interval_max
            n longest times in which the angles can have changed since the last check [s].
        inertias, loads
            n joint inertias [kg m^2] and n loads computed with the model [Nm]; `ExpectedMotion` is
            not checked for a joint with the inertia NaN.
        """
        first = ''
        for i, encoder, angle, amps, commanded, noisy, is_fresh, interval, inertia, load in zip(
            range(len(fresh)),
            self._encoders,
            position.tolist(),
            current.tolist(),
            feed_forward,
            braking_noise,
            fresh,
            interval_max,
            inertias,
            loads,
            strict=True,
        ):
            if not is_fresh:
                continue
            jump = encoder.check_angle(angle, now, interval)
            stand = encoder.check_standstill(amps, commanded, noisy, self._stall_time)
            fault = jump or stand or encoder.check_motion(amps, noisy, inertia, load)
            if fault:
                self.trusted[i] = False
                self.has_doubts = True
                first = first or fault
            if self.has_doubts and not self.trusted[i]:
                self.is_position_reliable[i] = encoder.is_position_reliable
                self.damping_speed[i] = encoder.damping_speed
        return first


class _Encoder:
    """State of the encoder monitor for a single motor; all quantities refer to the motor side.

    The first check processes a change from NaN, which initializes all attributes that
    `check_standstill` reads.

    Attributes
    ----------
    anchor
        Angle before a jump that awaits confirmation, NaN without one [rad].
    change, elapsed
        Change of the angle [rad] and time [s] since the previous check.
    doubted_for
        Duration of a standstill that awaits confirmation, NaN without one [s].
    expected
        Estimate of the motion that the current must cause.
    fastest, speed
        Largest plausible speed, and absolute speed at the last check without a jump [rad/s].
    held, load
        Currents that dry friction may hold, and that the largest load requires [A].
    has_jumped, is_settling
        Whether the angle jumped and did not return; whether the last check saw motion.
    model_scale
        Motor current per modelled load torque [A/Nm].
    moving_current, moving_feedback, moving_noise
        Motor current at or just after the last change of angle, the part of it that was not
        commanded as effort, and its noise, if the joint was braked [A].
    position, seen
        Angle [rad] and time [s] of the last check.
    standing, stood_at
        Duration [s] of an implausible standstill, and its angle [rad], NaN after motion.
    """

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
        """Clear the fault of the encoder; monitoring starts at its present angle."""
        self.position = self.anchor = nan  # NaN, so that the next angle does not count as a jump
        self.stood_at = nan
        self.jumps = 0
        self.has_jumped = self.is_confirmed = False
        self.expected.restart()

    @property
    def is_position_reliable(self) -> bool:
        """Whether the joint position that is computed from this encoder is reliable."""
        return not self.jumps and self.stood_at != self.stood_at

    @property
    def is_lost(self) -> bool:
        """Whether the encoder's count is wrong after a jump or a confirmed standstill."""
        return self.has_jumped or self.is_confirmed

    @property
    def damping_speed(self) -> float:
        """Largest motor speed [rad/s] that the board may damp with this encoder."""
        if self.is_confirmed:
            return 0.0
        if self.anchor == self.anchor:
            return _SPEED_FACTOR * self.speed + _SPEED_ALLOWANCE
        return inf

    def check_angle(self, position: float, now: float, interval: float) -> str:
        """Check a motor angle [rad] for a jump since the last angle, `interval` [s] ago or less."""
        elapsed = now - self.seen
        self.elapsed = interval if interval < elapsed else elapsed
        self.is_pause = interval > _PAUSE
        self.seen = now
        last, self.position = self.position, position
        self.change = position - last
        doubted = self.anchor == self.anchor
        # The second reading is compared with the angle before the jump.
        before = self.anchor if doubted else last
        time = self.since_anchor + interval if doubted else interval
        change = abs(position - before)
        self.anchor = nan
        if not change > self.fastest * time + _JUMP_ALLOWANCE:
            if doubted and change > self._slowly(time):
                self.has_jumped = True
            is_known = change == change and time > 0.0  # not at the first check
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
        """Return the largest plausible motion [rad] in `time` [s], given the last speed."""
        return (_SPEED_FACTOR * self.speed + _SPEED_ALLOWANCE) * time + _JUMP_ALLOWANCE

    def check_standstill(
        self, current: float, commanded: float, noise: float, stall_time: float
    ) -> str:
        """Return a fault text if the motor stands still despite a change of current [A], or ''."""
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
            # The current at the last check may have included a braking current, which vanishes at
            # rest.
            self.is_settling = False
            if abs(current) < abs(self.moving_current):
                self.moving_current, self.moving_feedback = current, feedback
        self.doubted_for += self.elapsed
        if self.doubted_for > stall_time:
            self.is_confirmed = True
        noisy = self.moving_noise if self.moving_noise > noise else noise
        held = self.held + _LOAD_SHARE * abs(current) + noisy
        unexplained = abs(current - self.moving_current)
        if noise or abs(current) <= self.load:
            by_feedback = abs(feedback - self.moving_feedback)
            unexplained = by_feedback if by_feedback < unexplained else unexplained
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

    def check_motion(self, current: float, noise: float, inertia: float, load: float) -> str:
        """Return a fault text if a resting joint must have moved with its inertia and load, or ''.

        Call after `check_standstill` with the same currents [A]. `inertia` [kg m^2] is NaN if it
        is unknown; `load` is the modelled load torque [Nm].
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
        """Record an implausible standstill; a second reading has to confirm the fault."""
        if self.doubted_for != self.doubted_for:
            self.doubted_for = 0.0
            self.stood_at = self.position
