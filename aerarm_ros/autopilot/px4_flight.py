"""Lockstep connection to the PX4 firmware (SITL), from its start to the flight."""

import time

import numpy as np

from aerarm_ros.autopilot.firmware_flight import LockstepFirmware
from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.mavlink_line import companion_writer
from aerarm_ros.autopilot.px4 import GPS, VISION
from aerarm_ros.autopilot.px4_link import CompanionLink, Controls, SimulatorLink
from aerarm_ros.autopilot.px4_sensors import SensorFrames
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

STEP_US = 4000
"""Interval between sensor samples while PX4 starts [us]."""

_BOOT, _ANSWER = 0.02, 2.0  # [s] of this host: before PX4's first answer, and after it
_LISTEN = 0.05  # [s]
_SETTLED = 2.0  # [s] of PX4's time with a position before arming


class Px4Firmware(LockstepFirmware):
    """Connection to PX4, which runs in lockstep with the simulation.

    PX4's clock is set by the stamps of the sensor messages. That clock continues while the
    simulation pauses and holds the drone. PX4's estimator and rotors need seconds to start.

    Parameters
    ----------
    sensors : str
        One of `px4.SENSORS`.
    seed : int
        Seed of the sensors' noise.
    """

    # PX4 takes off only toward a distant set point. PX4 would take the lift of a drone that does
    # not rise for its hover thrust, so the lift must soon exceed the weight.
    rise = 0.3
    _name, _system, _second = 'PX4', 0, 1e6
    _led, _mode_shift = 6, 16  # the main mode offboard
    _arms_on_set_points = True
    _worries = ('Arming denied', 'Preflight')

    def __init__(
        self,
        simulator: SimulatorLink,
        companion: CompanionLink,
        sensors: str = VISION,
        seed: int = 0,
    ) -> None:
        super().__init__(simulator, companion)
        self._simulator = simulator
        self._frames = SensorFrames(companion_writer(), sensors, seed)
        self._time, self._beat_at, self._sent = float(STEP_US), 0.0, 0
        self._is_heard = False
        self._is_gps = sensors == GPS
        self._offsets: list[Array] = []
        self._placed: float | None = None
        self._controls: Controls | None = None

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance PX4 by `dt` [s]; return thrust fractions (16,), None without an answer."""
        return self._step(state, round(1e6 * dt), is_placed, is_held=False)

    def _held_step(self, state: FlightState) -> Array | None:
        return self._step(state, STEP_US, is_placed=True, is_held=True)

    def _step(
        self, state: FlightState, step_us: int, is_placed: bool, is_held: bool
    ) -> Array | None:
        self._beat()
        self._await_taken()
        self._time += max(step_us, 1)
        time_us = round(self._time)
        frames = self._frames.frames(time_us, state, is_placed, is_held)
        patience = _BOOT if self._controls is None else _ANSWER
        answer = self._simulator.step(time_us, frames, patience)
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

    def _take(self, message: Message) -> None:
        self._is_heard = True
        super()._take(message)

    def _has_settled(self, place: Array) -> bool:
        if self._place is None:
            return False
        if self._placed is None:
            self._placed = self._time
        self._offsets.append(self._place - place)
        if self._time - self._placed <= 1e6 * _SETTLED:
            return False
        if self._is_gps:  # otherwise PX4's frame is that of the odometry
            self.origin = np.mean(self._offsets[len(self._offsets) // 2 :], axis=0)
        return True

    def _is_armed(self) -> bool:
        return self._controls is None or self._controls.is_armed

    def _take_off(self) -> None:
        """Do nothing, because the set points lead PX4 upward."""
