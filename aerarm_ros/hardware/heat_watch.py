"""Keeps motors and supply within what they bear, beside the cycle's limits of motion."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.arm_measurements import ArmMeasurements
from aerarm_ros.hardware.boards.board_link import BoardLink
from aerarm_ros.hardware.boards.board_mode import BoardMode
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.safety_gate import SafetyGate
from aerarm_ros.hardware.heat.supply_watch import SupplyWatch
from aerarm_ros.hardware.heat.thermal_limit import ThermalLimit

# One motor's temperatures are updated in a cycle, each once in so many; forecasts are rarer.
_CYCLES = 20
_FORECASTS = 50


class HeatWatch:
    """Feeds the estimates of temperature, applies reduced torques, and trips the gate's stop.

    Short braking needs more than a reduced torque: the barriers at the limits keep the motors'
    whole torque, and so does the damping of a stopped arm.

    Parameters
    ----------
    config
        Motors and supply.
    settings
        Temperatures of the air, and of the motors at first.
    profile
        Tells what the boards report.
    gate, links, references
        What is limited and read.

    Attributes
    ----------
    limits
        One `ThermalLimit` a joint.
    supplies
        One `SupplyWatch` a board; none where frames carry no supply voltage.
    unknown
        What the configuration does not say of its motors.
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
        self._cycle = self._turns = 0
        self._cycles = max(_CYCLES, config.n)
        unknown = {joint.motor.name for joint in config.joints if joint.motor.thermal is None}
        self.unknown = [
            f'no thermal data for motor {name}: a third of its current_max counts as continuous; '
            f'set motors.{name}.thermal in the configuration'
            for name in sorted(unknown)
        ]

    def update(self, state: ArmMeasurements, elapsed: float, enabled: bool) -> None:
        """Take a cycle's measurements, an elapsed time [s] after those before."""
        if elapsed == inf:
            return  # the first cycle
        currents = state.motor_current.tolist()
        limits = self.limits
        # A board that receives nothing for longer switches off.
        driven = min(elapsed, self._board_timeout)
        for limit, current, (link, _) in zip(limits, currents, self._places, strict=True):
            if current != current:
                continue  # no board has answered yet
            if link.monitor.mode is BoardMode.ALIGNING:
                current = limit.continuous_current  # a board that aligns reports none
            limit.add(current, driven)
            if elapsed > driven:
                limit.add(0.0, elapsed - driven)
        self._cycle = (self._cycle + 1) % self._cycles
        if self._cycle < len(limits):
            self._take_turn(self._cycle, enabled)
        if self.supplies:
            self._look_at_supplies(elapsed, enabled)

    def refusal(self) -> str:
        """Return why the motors may not be driven yet, or ''."""
        return next(filter(None, (limit.refusal() for limit in self.limits)), '')

    def warnings(self) -> list[str]:
        """Return what is to be said of motors and supply."""
        texts = [limit.warning() for limit in self.limits]
        texts += [supply.warning() for supply in self.supplies]
        return [*filter(None, texts)]

    def _take_turn(self, joint: int, enabled: bool) -> None:
        """Update one motor, and what its joint may do."""
        limit, gate = self.limits[joint], self._gate
        link, channel = self._places[joint]
        limit.update(link.state.coil_resistance[channel])
        if joint == 0:
            self._turns += 1
        if (self._turns + joint) % _FORECASTS == 0:
            limit.forecast()
        barrier = gate.barriers[joint]
        if enabled:
            limit.carries(barrier.load)
            if limit.stop():
                gate.trip(limit.stop())
        else:
            limit.rest()
        gate.limit_effort(joint, limit.effort_limit)
        self._references.motors[joint].effort_limit = limit.effort_limit
        barrier.hold_back(limit.is_sinking)
        barrier.lets_down = limit.lets_down

    def _look_at_supplies(self, elapsed: float, enabled: bool) -> None:
        for link, supply in zip(self._links, self.supplies, strict=True):
            if not link.fresh:
                continue
            for _, channel in link.joints:
                supply.update(link.state.bus_voltage[channel], elapsed)
            if enabled and supply.stop():
                self._gate.trip(supply.stop())
