"""Simulated flight with the PX4 firmware (SITL), with feedforward of the arm's motion."""

import time
from enum import Enum
from typing import Any, Protocol

import numpy as np

from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.px4_link import (
    COMPANION,
    Companion,
    Controls,
    Simulator,
    companion_writer,
)
from aerarm_ros.autopilot.px4_sensors import SensorFrames
from aerarm_ros.autopilot.px4_setup import GPS, Px4Setup
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array

STEP_US = 4000
"""Interval between sensor samples while PX4 starts [us]."""

_UP = np.array([0.0, 0.0, 1.0])
_BOOT, _ANSWER = 0.02, 2.0  # [s] of this host: before PX4's first answer, and after it
_LISTEN = 0.05  # [s]
_SETTLED = 2.0  # [s] of PX4's time with a position before arming
_ASK_EVERY = 0.5  # [s] of PX4's time between two requests to arm
# Height [m] of the set point above the held drone, because PX4 takes off only toward a distant set
# point. PX4 would take the lift of a drone that does not rise for its hover thrust, so the lift
# must soon exceed the weight. Then the set point is lowered in the given time [s] without a step.
_ABOVE, _LOWERING = 0.3, 2.0
_HEARTBEAT = 0.5  # [s]
_ARM, _SET_MODE = 400, 176  # MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE
_CUSTOM_MODE, _OFFBOARD, _ARMED = 1, 6, 128
_TEXTS = 50  # number of stored messages from PX4


class FlightStage(Enum):
    """Stage of PX4's start and take-off; each value is the status text for the user."""

    BOOT = 'no answer from PX4 yet: start PX4 before this node, as instance autopilot_instance'
    SETTLE = "PX4's estimator is settling"
    ARM = 'PX4 is arming'
    SPOOL = "PX4's rotors are spooling up"
    FLY = ''


class Px4Firmware:
    """Connection to PX4, which runs in lockstep with the simulation.

    The simulation holds the drone until PX4 has started the rotors.

    PX4's clock is set by the stamps of the sensor messages. That clock continues while the
    simulation pauses and holds the drone. PX4's estimator and rotors need seconds to start.

    Parameters
    ----------
    simulator, companion
        Connections to PX4, as its simulator and as a companion computer.
    setup : Px4Setup
        Setup of the firmware.
    seed : int
        Seed of the sensors' noise.

    Attributes
    ----------
    texts : list of str
        Messages of PX4, the newest last, such as rejections of set points.
    origin : (3,) ndarray
        Origin of PX4's local frame in the world, north-east-down [m].
    rise : float
        Height [m] above the held drone to which the first set points lead it.
    """

    def __init__(
        self, simulator: Simulator, companion: Companion, setup: Px4Setup, seed: int = 0
    ) -> None:
        self._simulator, self._companion = simulator, companion
        self._writer = companion_writer()
        self._frames = SensorFrames(companion_writer(), setup.sensors, seed)
        self._time_us = STEP_US
        self._asked_us = self._beat_us = self._sent = 0
        self._is_heard = False
        self._is_gps = setup.sensors == GPS
        self._offsets: list[Array] = []
        self._placed_us: int | None = None
        self._controls: Controls | None = None
        self._place: Array | None = None
        self._mode = 0
        self.stage = FlightStage.BOOT
        self.texts: list[str] = []
        self.origin = np.zeros(3)
        self.rise = _ABOVE

    @property
    def problem(self) -> str:
        """Reason why PX4 does not fly the drone; empty while PX4 flies it."""
        if self._simulator.is_lost:
            return 'PX4 has ended or closed the connection: restart PX4 and this node'
        if self.stage is FlightStage.FLY:
            return self._loss()
        texts = [text for text in self.texts[-3:] if 'Arming denied' in text or 'Preflight' in text]
        return '; '.join([self.stage.value, *texts])

    @property
    def is_flying(self) -> bool:
        """Whether the simulation has released the drone."""
        return self.stage is FlightStage.FLY

    @property
    def wants_set_points(self) -> bool:
        """Whether PX4 needs set points to arm while the simulation holds the drone."""
        return self.stage in (FlightStage.ARM, FlightStage.SPOOL)

    @property
    def is_led(self) -> bool:
        """Whether PX4 is in offboard mode, in which it follows set points."""
        return self._mode >> 24 == _OFFBOARD

    @property
    def time_ms(self) -> int:
        """PX4's time [ms]."""
        return self._time_us // 1000

    def send(self, name: str, **values: object) -> None:
        """Send a MAVLink message to PX4."""
        self._companion.send(self._writer.pack(name, **values))

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance PX4 by `dt` [s]; return thrust fractions (16,), None without an answer."""
        return self._step(state, round(1e6 * dt), is_placed, is_held=False)

    def hold(self, state: FlightState, lift: float) -> Array | None:
        """Advance PX4 by a step with the drone held in place; return thrust fractions (16,).

        `lift` is the sum of the rotors' thrust fractions that carries the drone. The result is None
        without an answer.
        """
        shares = self._step(state, STEP_US, is_placed=True, is_held=True)
        place = ned(state.position)
        if self.stage is FlightStage.BOOT and self._controls is not None:
            self.stage = FlightStage.SETTLE
        elif self.stage is FlightStage.SETTLE:
            self._settle(place)
        elif self.stage is FlightStage.ARM:
            self._ask()
        elif self.stage is FlightStage.SPOOL and self._controls is not None:
            if not self._controls.is_armed:
                self.stage = FlightStage.ARM
            elif float(self._controls.shares.sum()) > lift:
                self.stage = FlightStage.FLY
        return shares

    def _step(
        self, state: FlightState, step_us: int, is_placed: bool, is_held: bool
    ) -> Array | None:
        self._beat()
        self._await_taken()
        self._time_us += max(step_us, 1)
        frames = self._frames.frames(self._time_us, state, is_placed, is_held)
        patience = _BOOT if self._controls is None else _ANSWER
        answer = self._simulator.step(self._time_us, frames, patience)
        for message in self._companion.messages():
            self._take(message)
        if answer is None:
            return None
        self._controls = answer
        return answer.shares

    def _await_taken(self) -> None:
        """Wait until PX4 has processed all messages sent to it.

        PX4 answers messages in order, so the answer to a TIMESYNC proves that PX4 has processed all
        earlier ones. PX4's receiver does not run in lockstep. Without this wait, PX4 on a busy host
        would process the messages one or more steps late.
        """
        if not self._is_heard:
            return
        self._sent += 1
        self.send('TIMESYNC', ts1=self._sent)
        deadline, is_taken = time.monotonic() + _ANSWER, False
        while not is_taken and time.monotonic() < deadline and not self._simulator.is_lost:
            for message in self._companion.messages(_LISTEN):
                is_taken |= message.name == 'TIMESYNC' and message['ts1'] == self._sent
                self._take(message)

    def _settle(self, place: Array) -> None:
        if self._place is None:
            return
        if self._placed_us is None:
            self._placed_us = self._time_us
        self._offsets.append(self._place - place)
        if self._time_us - self._placed_us > 1e6 * _SETTLED:
            if self._is_gps:  # otherwise PX4's frame is that of the odometry
                self.origin = np.mean(self._offsets[len(self._offsets) // 2 :], axis=0)
            self.stage = FlightStage.ARM

    def _ask(self) -> None:
        """Request offboard mode, then arming, every 0.5 s until PX4 is armed."""
        if self._mode & _ARMED and self.is_led:
            self.stage = FlightStage.SPOOL
            return
        if self._time_us - self._asked_us < 1e6 * _ASK_EVERY:
            return
        self._asked_us = self._time_us
        if not self.is_led:
            self._command(_SET_MODE, _CUSTOM_MODE, _OFFBOARD)
        else:
            self._command(_ARM, 1.0)

    def _command(self, command: int, *parameters: float) -> None:
        values = {f'param{i}': value for i, value in enumerate(parameters, 1)}
        self.send('COMMAND_LONG', target_system=0, target_component=1, command=command, **values)

    def _beat(self) -> None:
        if self._time_us - self._beat_us > 1e6 * _HEARTBEAT:
            self._beat_us = self._time_us
            self.send('HEARTBEAT', **COMPANION)

    def _take(self, message: Message) -> None:
        self._is_heard = True
        if message.name == 'HEARTBEAT' and message.component == 1:
            # Main mode in bits 16 to 23 of the custom mode, combined with the flags of the base
            # mode.
            self._mode = (message['custom_mode'] >> 16 & 0xFF) << 24 | message['base_mode']
        elif message.name == 'LOCAL_POSITION_NED':
            self._place = np.array([message['x'], message['y'], message['z']])
        elif message.name == 'STATUSTEXT':
            self.texts = [*self.texts[1 - _TEXTS :], message['text']]

    def _loss(self) -> str:
        if self._controls is not None and not self._controls.is_armed:
            return 'PX4 has disarmed: ' + '; '.join(self.texts[-2:])
        return ''


class LockstepFirmware(Protocol):
    """Interface of an autopilot firmware on this host that runs in lockstep with the simulation.

    Attributes
    ----------
    origin : (3,) ndarray
        Origin of the firmware's local frame in the world, north-east-down [m].
    rise : float
        Height [m] above the held drone to which the first set points lead it.
    """

    origin: Array
    rise: float

    @property
    def problem(self) -> str:
        """Reason why the firmware does not fly the drone; empty while the firmware flies it."""

    @property
    def is_flying(self) -> bool:
        """Whether the simulation has released the drone."""

    @property
    def wants_set_points(self) -> bool:
        """Whether the firmware needs set points while the simulation holds the drone."""

    @property
    def time_ms(self) -> int:
        """Present time on the clock of the firmware [ms]."""

    def send(self, name: str, **values: object) -> None:
        """Send a MAVLink message."""

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance the firmware by `dt` [s]; return thrust fractions, None without an answer."""

    def hold(self, state: FlightState, lift: float) -> Array | None:
        """Advance the firmware a step with the drone held in place; return thrust fractions."""


class SetPoints(Protocol):
    """Interface of an object that creates set point messages with the arm's feedforward."""

    def reset(self) -> None:
        """Reset the integral of the position loop."""

    def message(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward, origin: Array
    ) -> tuple[str, dict[str, Any]]:
        """Return message name and fields of the set point, without its time stamp."""


class FirmwareFlight:
    """Flight control by an autopilot firmware that follows set points, instead of `FlightControl`.

    Parameters
    ----------
    body : MassProperties
        Mass properties of drone and arm at rest.
    firmware : LockstepFirmware
        Connection to the firmware.
    set_points : SetPoints
        Creates the set points.

    Attributes
    ----------
    problem : str
        Reason why the firmware does not command the rotors; empty while it commands them.
    is_settling : bool
        Whether the firmware is starting, so that `settle` must be called.
    """

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        firmware: LockstepFirmware,
        set_points: SetPoints,
    ) -> None:
        self._firmware = firmware
        self._thrust_max = drone.column('thrust_max')
        self._at_rest = FeedForward.at_rest(body)
        self._lift = body.mass * GRAVITY / float(np.mean(self._thrust_max * drone.allocation[2]))
        self._above = firmware.rise
        self._held: FlightState | None = None
        self._set_points = set_points
        self._shares = np.zeros(drone.n)

    @property
    def problem(self) -> str:
        """Reason why the firmware does not command the rotors; empty while it commands them."""
        return self._firmware.problem

    @property
    def is_settling(self) -> bool:
        """Whether the firmware is still starting; call `settle` instead of `update` then."""
        return self._held is not None and not self._firmware.is_flying

    def reset(self) -> None:
        """Reset the integral of the position loop."""
        self._set_points.reset()

    def settle(self) -> None:
        """Advance the firmware's time with the drone held at its last position."""
        if self._held is None:
            return
        if self._firmware.wants_set_points:
            self._lead(self._held, FlightTarget.here(self._held), 0.0, self._at_rest)
        self._note(self._firmware.hold(self._held, self._lift))

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Advance the firmware by `dt` [s]; return the thrusts (n,) [N] that it commands."""
        if not self._firmware.is_flying:
            self._held = state
            self.settle()
            return self._thrusts()
        if dt > 0.0:  # otherwise this is the state at the take-off
            self._lead(state, target, dt, self._at_rest if arm is None else arm)
            self._note(self._firmware.step(state, dt))
        return self._thrusts()

    def level(self, state: FlightState, dt: float) -> Array:
        """Return thrusts (n,) [N] of the firmware's failsafe, which flies without odometry."""
        self._note(self._firmware.step(state, dt, is_placed=False))
        return self._thrusts()

    def _note(self, shares: Array | None) -> None:
        if shares is not None:
            self._shares = np.clip(shares[: len(self._thrust_max)], 0.0, 1.0)

    def _thrusts(self) -> Array:
        return np.asarray(self._shares * self._thrust_max)

    def _lead(self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward) -> None:
        self._above *= float(np.exp(-dt / _LOWERING))
        above = target._replace(position=target.position + self._above * _UP)
        name, values = self._set_points.message(state, above, dt, arm, self._firmware.origin)
        self._firmware.send(name, time_boot_ms=self._firmware.time_ms, **values)
