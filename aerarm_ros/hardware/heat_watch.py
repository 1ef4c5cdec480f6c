"""Estimation of motor temperatures, which cause warnings, torque reduction and a stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf, sqrt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import COPPER, RATED_AMBIENT, JointConfig, MotorConfig
from aerarm_ros.hardware.boards.board_link import ArmMeasurements, BoardLink
from aerarm_ros.hardware.boards.board_monitor import BoardMode, SupplyWatch
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.safety_gate import SafetyGate

_COPPER_REFERENCE = 20.0  # [degC] temperature to which `COPPER` refers
# A reported resistance is used if it lies within these multiples of the configured one.
_PLAUSIBLE = (0.5, 2.0)
# The forecast covers at most this time [s]; repeated halving refines it to 0.2 ms.
_HORIZON = 3600.0
_HALVINGS = 24


class MotorTemperature:
    """Thermal model of a motor as two bodies: winding with stator, and housing with mount.

    Copper loss ``3/2 R i^2`` (thesis section 4.1, amplitude of the phase current) enters the
    winding. Heat flows through ``R_wh`` into the housing and through ``R_ha`` into the air. The
    sum of both thermal resistances follows from the continuous current, which heats the winding
    to its largest temperature at 25 degC ambient temperature. The time constants are ``tau_w =
    R_wh C_w`` and ``tau_h = R_ha C_h``. Motor manufacturers state this two-body model, for
    example maxon in "The selection of high-precision microdrives", with winding and motor time
    constants.

    The model uses the larger of the reported resistance and the configured resistance scaled to the
    winding temperature, because a board may report a firmware constant. If the configured
    resistance was measured on a bench, the first reported resistance reveals a motor that is
    already warm.

    Plain floats are used, because they are faster than arrays for four motors.

    Parameters
    ----------
    motor
        Resistance and thermal data.
    ambient
        Temperature of the air [degC].
    start
        Initial temperature of winding and housing [degC].

    Attributes
    ----------
    winding, housing
        Estimated temperatures of winding and housing [degC].
    """

    def __init__(self, motor: MotorConfig, ambient: float, start: float) -> None:
        thermal = motor.thermal_or_guess
        self._ambient = ambient
        self._resistance = motor.resistance
        self._reported = 0.0
        self.winding = self.housing = max(start, ambient)
        self._hottest = hottest = thermal.temperature_max
        self._is_measured = motor.resistance_std is not None
        loss = 1.5 * self.resistance(hottest) * thermal.continuous_current**2
        total = (hottest - RATED_AMBIENT) / loss
        self._to_ambient = thermal.housing_share * total
        self._to_housing = total - self._to_ambient
        self._capacity_winding = thermal.winding_time / self._to_housing
        self._capacity_housing = thermal.housing_time / self._to_ambient

    def resistance(self, temperature: float) -> float:
        """Return the phase resistance [ohm] at a winding temperature [degC]."""
        grown = 1.0 + COPPER * (temperature - _COPPER_REFERENCE)
        rated = 1.0 + COPPER * (RATED_AMBIENT - _COPPER_REFERENCE)
        return max(self._reported, self._resistance * grown / rated)

    def report(self, resistance: float) -> None:
        """Process the phase resistance [ohm] that the board reports; 0 means unknown."""
        low, high = _PLAUSIBLE
        ratio = resistance / self._resistance
        self._reported = resistance if low < ratio < high else 0.0
        if self._reported and self._is_measured:
            # Done only once, because the motor may be warmer than assumed when the bridge starts.
            self._is_measured = False
            grown = (ratio - 1.0) / COPPER * (1.0 + COPPER * (RATED_AMBIENT - _COPPER_REFERENCE))
            self.winding = max(self.winding, min(RATED_AMBIENT + grown, self._hottest))

    def update(self, square: float, duration: float) -> None:
        """Advance the temperatures by `duration` [s] with a mean squared current [A^2].

        The step uses the implicit Euler method, which is stable for any duration.
        """
        loss = 1.5 * self.resistance(self.winding) * square
        a = duration / (self._capacity_winding * self._to_housing)
        b = duration / (self._capacity_housing * self._to_housing)
        c = duration / (self._capacity_housing * self._to_ambient)
        warmed = self.winding + duration * loss / self._capacity_winding
        aired = self.housing + c * self._ambient
        self.housing = (aired * (1.0 + a) + b * warmed) / ((1.0 + a) * (1.0 + b + c) - a * b)
        self.winding = (warmed + a * self.housing) / (1.0 + a)

    def time_until(self, temperature: float, square: float) -> float:
        """Return the time [s] until the winding reaches a temperature [degC]; inf for never.

        The two linear equations are solved with the resistance at that temperature.
        """
        if self.winding >= temperature:
            return 0.0
        loss = 1.5 * self.resistance(temperature) * square
        steady_housing = self._ambient + loss * self._to_ambient
        steady = steady_housing + loss * self._to_housing
        if steady <= temperature:
            return inf
        out = 1.0 / (self._capacity_winding * self._to_housing)
        into = 1.0 / (self._capacity_housing * self._to_housing)
        away = into + 1.0 / (self._capacity_housing * self._to_ambient)
        root = sqrt((out - away) ** 2 + 4.0 * out * into)
        slow, fast = 0.5 * (root - out - away), 0.5 * (-root - out - away)
        winding, housing = self.winding - steady, self.housing - steady_housing
        rate = out * (housing - winding)
        first = (rate - fast * winding) / (slow - fast)
        second = winding - first
        low, high = 0.0, _HORIZON
        if steady + first * exp(slow * high) + second * exp(fast * high) < temperature:
            return inf
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            reached = steady + first * exp(slow * middle) + second * exp(fast * middle)
            if reached < temperature:
                low = middle
            else:
                high = middle
        return high


# A warning appears, the torque reduction begins, and the torque is reduced to that of the
# continuous current at these distances [K] below the largest winding temperature. The arm stops
# at the largest temperature.
_WARNING, _REDUCTION, _CONTINUOUS = 30.0, 20.0, 5.0
# If the winding exceeds its largest temperature by this [K], a joint of a stopped arm that the
# barrier holds at a limit is lowered.
_LETTING_DOWN = 5.0
# A warning also appears this time [s] before the torque reduction, ...
_WARNING_TIME = 30.0
# ... predicted with the mean current over this time [s].
_MEAN_TIME = 2.0
# A warning or reduction ends when the winding is this much [K] cooler than when it began.
_HYSTERESIS = 3.0
# Rates of the torque limit [1/s]: it falls within one second and recovers more slowly.
_FALL, _RISE = 1.0, 0.2
# Load relative to the reduced torque above which the arm counts as sinking, below which as held.
_SINKING, _HELD = 1.0, 0.9
# Weight of the newest load in the mean load: 0.1 s at 50 updates per second.
_LOAD_SHARE = 0.2


class ThermalLimit:
    """Warns of a warm motor, then reduces its torque limit, and finally stops the arm.

    The limit of the squared current falls with the winding temperature: from the current of the
    effort limit to the continuous current, 5 K below the largest temperature. At that temperature
    and current the winding becomes no warmer. A command can therefore not overheat the winding;
    only a load that the barrier must hold at a position limit can.

    Parameters
    ----------
    ambient, start
        Temperature of the air, and initial temperature of the motor [degC].

    Attributes
    ----------
    motor
        Temperature estimate.
    continuous_current
        Current [A] at which the winding settles 5 K below its largest temperature.
    effort_limit
        Largest torque that a command may request from the joint [Nm].
    remaining
        Time until the torque limit is reduced, at the present mean current [s]; 0 if it is
        reduced already, inf if it never will be.
    is_sinking
        Whether the load of the arm's weight exceeds the reduced torque.
    is_released
        Whether the joint is lowered slowly until its motor is off, because the warm motor can no
        longer hold the joint at a position limit.
    """

    def __init__(self, joint: JointConfig, ambient: float, start: float) -> None:
        thermal = joint.motor.thermal_or_guess
        self.motor = MotorTemperature(joint.motor, ambient, start)
        self.remaining = inf
        self.is_sinking = self.is_released = False
        self._load = 0.0
        self._name = joint.name
        self._effort_max = self.effort_limit = joint.effort_max
        self._per_ampere = joint.torque_per_ampere
        self._largest = (joint.effort_max / joint.torque_per_ampere) ** 2
        self._temperature_max = hottest = thermal.temperature_max
        # Warmer air removes less heat.
        rise = max(hottest - _CONTINUOUS - ambient, 1.0) / (hottest - RATED_AMBIENT)
        self._continuous = min(rise * thermal.continuous_current**2, self._largest)
        self.continuous_current = sqrt(self._continuous)
        self._square = 0.0  # mean over some seconds
        self._sum = self._duration = 0.0
        self._is_warm = self._stops = False
        self._worst = 0  # stage of the worst warning since the motor was cool

    @property
    def is_reduced(self) -> bool:
        """Whether the joint's torque is currently reduced."""
        return self.effort_limit < self._effort_max

    def recall(self, winding: float, housing: float, away: float) -> None:
        """Raise the estimates to stored temperatures [degC], cooled for `away` [s]."""
        motor, most = self.motor, self._temperature_max + _KEPT_MAX
        before = motor.winding, motor.housing
        motor.winding, motor.housing = min(winding, most), min(housing, most)
        for _ in range(_COOLINGS):
            motor.update(0.0, away / _COOLINGS)
        motor.winding = max(motor.winding, before[0])
        motor.housing = max(motor.housing, before[1])

    def add(self, current: float, duration: float) -> None:
        """Add the heat of a motor current [A] that flowed for `duration` [s]."""
        self._sum += current * current * duration
        self._duration += duration

    def update(self, resistance: float) -> None:
        """Update temperatures and torque limit; `resistance` [ohm] is measured, 0 if unknown."""
        duration = self._duration
        if duration <= 0.0:
            return
        square = self._sum / duration
        self._sum = self._duration = 0.0
        self.motor.report(resistance)
        self.motor.update(square, duration)
        self._square += duration / (_MEAN_TIME + duration) * (square - self._square)
        winding, hottest = self.motor.winding, self._temperature_max
        self._stops = winding >= hottest
        self.is_released = self.is_released or winding > hottest + _LETTING_DOWN
        warm = hottest - _WARNING - (_HYSTERESIS if self._is_warm else 0.0)
        self._is_warm = winding > warm or self.remaining < _WARNING_TIME
        self._limit(duration)

    def forecast(self) -> None:
        """Update `remaining`, the time to the torque reduction; call about once per second."""
        threshold = self._temperature_max - _REDUCTION
        self.remaining = self.motor.time_until(threshold, self._square)

    def add_load(self, load: float) -> None:
        """Record the load torque [Nm] of the arm's weight and motion; call after `update`."""
        self._load += _LOAD_SHARE * (load - self._load)
        share = _HELD if self.is_sinking else _SINKING
        self.is_sinking = self.is_reduced and abs(self._load) > share * self.effort_limit

    def rest(self) -> None:
        """Reset the load estimate, because the motor is off."""
        self.is_sinking = self.is_released = False
        self._load = 0.0

    def stop(self) -> str:
        """Return the reason if the motor's temperature requires a stop of the arm, or ''."""
        if not self._stops:
            return ''
        return (
            f'the motor of {self._name} has {self.motor.winding:.0f} degC (estimated), above its '
            f'limit of {self._temperature_max:.0f}: support the arm, disable it, let the motor '
            'cool'
        )

    @property
    def wait(self) -> str:
        """Text on the temperature to which the motor must cool before use, or ''."""
        cool = self._temperature_max - _REDUCTION
        if self.motor.winding <= cool:
            return ''
        return f'wait until the motor of {self._name} has cooled to {cool:.0f} degC'

    def refusal(self) -> str:
        """Return a text if the motor is too warm to be driven, otherwise ''."""
        if not self.wait:
            return ''
        return (
            f'the motor of {self._name} has {self.motor.winding:.0f} degC (estimated): {self.wait}'
        )

    def new_warning(self) -> str:
        """Return the warning if none as severe was returned since the motor was cool, or ''."""
        stage = sum((self._is_warm, self.is_reduced, self.is_sinking, self.is_released))
        rises = stage > self._worst
        self._worst = max(stage, self._worst) if stage else 0
        return self.warning() if rises else ''

    def warning(self) -> str:
        """Return the present warning about the motor temperature, '' without one."""
        name, temperature = self._name, f'{self.motor.winding:.0f} degC (estimated)'
        if self.is_released:
            return (
                f'{name} yields beyond its position limit because its motor has '
                f'{temperature}: support the arm'
            )
        if self.is_sinking:
            return (
                f'{name} sinks because its motor has {temperature} and only '
                f'{self.effort_limit:.2f} of {self._effort_max:.2f} Nm, less than the load: fold '
                'or support the arm'
            )
        if self.is_reduced:
            return (
                f'the torque of {name} is limited to {self.effort_limit:.2f} of '
                f'{self._effort_max:.2f} Nm because its motor has {temperature}: fold the arm, '
                'let the motor rest'
            )
        if not self._is_warm:
            return ''
        if self.remaining == inf:
            return f'the motor of {name} has {temperature}: let the motor rest'
        return (
            f'the motor of {name} has {temperature}; at this load the bridge limits its torque '
            f'in {self.remaining:.0f} s: fold the arm or lower its load'
        )

    def _limit(self, duration: float) -> None:
        """Move the torque limit towards the value for the present winding temperature."""
        left = self._temperature_max - _CONTINUOUS - self.motor.winding
        share = min(max(left / (_REDUCTION - _CONTINUOUS), 0.0), 1.0)
        square = self._continuous + share * (self._largest - self._continuous)
        wanted = self._effort_max if share == 1.0 else sqrt(square) * self._per_ampere
        fall, rise = _FALL * self._effort_max * duration, _RISE * self._effort_max * duration
        limit = min(max(wanted, self.effort_limit - fall), self.effort_limit + rise)
        self.effort_limit = min(limit, self._effort_max)


# Stored temperatures are limited to this much [K] above the largest temperature, so that a file
# cannot block an arm.
_KEPT_MAX = 30.0
_COOLINGS = 100  # number of integration steps over the time in which no bridge ran


@dataclass(frozen=True)
class KeptHeat:
    """Stored motor temperatures, which a bridge estimated at a time [s, monotonic].

    Attributes
    ----------
    windings, housings
        Temperatures of the joints' motors [degC], from base to tool.
    """

    time: float
    windings: tuple[float, ...]
    housings: tuple[float, ...]


_ALIGNING = BoardMode.ALIGNING
# Each cycle updates one motor, each motor once per `_CYCLES` cycles; forecasts are rarer.
_CYCLES = 20
_FORECASTS = 50


class HeatWatch:
    """Updates all motor temperatures, reduces torque limits, and stops the arm through the gate.

    The barriers at the limits and the damping of a stopped arm may always use the full motor
    torque, because braking is short and needs it.

    Parameters
    ----------
    config
        Configuration with motors and supply.
    settings
        Temperature of the air, and initial temperature of the motors.
    profile
        Frame layout, which determines the quantities that the boards report.
    gate, links, references
        Parts that this class limits or reads.

    Attributes
    ----------
    limits
        One `ThermalLimit` per joint.
    news
        Warnings that are worse than all earlier ones, for the log; the program that logs a
        warning removes it.
    supplies
        One `SupplyWatch` per board; empty if the frames carry no supply voltage.
    unknown
        Motor data that are missing in the configuration.
    """

    def __init__(
        self,
        config: ArmConfig,
        settings: BridgeSettings,
        profile: FrameProfile,
        gate: SafetyGate,
        links: Sequence[BoardLink],
        references: MotorReferences,
    ) -> None:
        ambient, start = settings.ambient_temperature, settings.start_temperature
        self.limits = [ThermalLimit(joint, ambient, start) for joint in config.joints]
        self.supplies = (
            [SupplyWatch(link.monitor.name, config.power_stage) for link in links]
            if profile.sensor.has('bus_voltage')
            else []
        )
        self._gate = gate
        self._links = tuple(links)
        self._references = references
        self._places = [(links[joint.board], joint.channel) for joint in config.joints]
        self._board_timeout = settings.board_timeout
        self.news: list[str] = []
        self._cycle = self._turns = 0
        self._cycles = max(_CYCLES, config.n)
        unknown = {joint.motor.name for joint in config.joints if joint.motor.thermal is None}
        self.unknown = [
            f'motor {name} has no thermal data, so a third of its current_max counts as '
            f'continuous current: set motors.{name}.thermal in the configuration'
            for name in sorted(unknown)
        ]

    def update(self, state: ArmMeasurements, elapsed: float, enabled: bool) -> None:
        """Process the measurements of a cycle, `elapsed` [s] after the previous cycle."""
        if elapsed == inf:
            return  # the first cycle
        currents = state.motor_current.tolist()
        limits = self.limits
        # A board that receives nothing for longer than this switches off.
        driven = min(elapsed, self._board_timeout)
        for link in self._links:
            is_silent = link.monitor.is_silent
            # a board that aligns reports no current
            is_unknown = link.monitor.mode is _ALIGNING or link.is_damped_without_answer
            for joint, _ in link.joints:
                limit, current = limits[joint], currents[joint]
                if current != current:
                    continue  # no board has answered yet
                if is_unknown:
                    current = limit.continuous_current
                elif is_silent:
                    current = 0.0  # the last answer is outdated for a motor that is off
                limit.add(current, driven)
                if elapsed > driven:
                    limit.add(0.0, elapsed - driven)
        self._cycle = (self._cycle + 1) % self._cycles
        if self._cycle < len(limits):
            self._take_turn(self._cycle, enabled)
        if self.supplies:
            self._look_at_supplies(elapsed, enabled)

    def keep(self, now: float) -> KeptHeat:
        """Return the motor temperatures to store, estimated at `now` [s]."""
        motors = [limit.motor for limit in self.limits]
        windings = tuple(motor.winding for motor in motors)
        return KeptHeat(now, windings, tuple(motor.housing for motor in motors))

    def recall(self, kept: KeptHeat, now: float) -> None:
        """Raise the estimates to the temperatures of a previous bridge, cooled since then."""
        away = max(now - kept.time, 0.0)
        rows = zip(self.limits, kept.windings, kept.housings, strict=False)
        for limit, winding, housing in rows:
            limit.recall(winding, housing, away)

    @property
    def wait(self) -> str:
        """Text on the motors that must cool before use, and to which temperature, or ''."""
        return ', '.join(filter(None, (limit.wait for limit in self.limits)))

    def refusal(self) -> str:
        """Return a text if a motor is too warm to be driven, otherwise ''."""
        return next(filter(None, (limit.refusal() for limit in self.limits)), '')

    def warnings(self) -> list[str]:
        """Return the warnings about motor temperatures and supply voltages."""
        texts = [limit.warning() for limit in self.limits]
        texts += [supply.warning() for supply in self.supplies]
        return [*filter(None, texts)]

    def _take_turn(self, joint: int, enabled: bool) -> None:
        """Update temperature and torque limit of the motor of a joint."""
        limit, gate = self.limits[joint], self._gate
        link, channel = self._places[joint]
        limit.update(link.state.coil_resistance[channel])
        if joint == 0:
            self._turns += 1
        if (self._turns + joint) % _FORECASTS == 0:
            limit.forecast()
        barrier = gate.barriers[joint]
        if enabled:
            limit.add_load(barrier.load)
            if limit.stop():
                gate.trip(limit.stop())
        else:
            limit.rest()
        gate.limit_effort(joint, limit.effort_limit)
        self._references.motors[joint].effort_limit = limit.effort_limit
        barrier.limit_speed(limit.is_sinking)
        barrier.is_released = limit.is_released
        if warning := limit.new_warning():
            self.news.append(warning)

    def _look_at_supplies(self, elapsed: float, enabled: bool) -> None:
        for link, supply in zip(self._links, self.supplies, strict=True):
            if not link.fresh:
                continue
            for _, channel in link.joints:
                supply.update(link.state.bus_voltage[channel], elapsed / len(link.joints))
            if enabled and supply.stop():
                self._gate.trip(supply.stop())
