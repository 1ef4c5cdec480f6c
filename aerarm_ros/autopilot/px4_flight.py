"""Lockstep connection to the PX4 firmware (SITL), from its start to the flight.

In a TCP connection this package acts as PX4's simulator: it sends sensor data and receives thrust
fractions. PX4's time is the time of the sensors (`src/modules/simulation/simulator_mavlink`).
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aerarm_ros.autopilot.firmware_flight import (
    LockstepFirmware,
    companion_line,
    odometry_frame,
    port_taken,
)
from aerarm_ros.autopilot.mavlink import FrameReader, Message
from aerarm_ros.autopilot.mavlink_line import ARMED, HOST, CompanionWriter, UdpLine
from aerarm_ros.autopilot.px4 import GPS, VISION, frd_rotation, ned
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

SIMULATOR_PORT, COMPANION_PORT, OFFBOARD_PORT = 4560, 14540, 14580
"""TCP port of the simulator, and UDP ports of companion and PX4, for PX4's instance 0."""
STEP_US = 4000
"""Interval between sensor samples while PX4 starts [us]."""

_CHUNK = 65536
_BOOT, _ANSWER = 0.02, 2.0  # [s] of this host: before PX4's first answer, and after it
_LISTEN = 0.05  # [s]
# Origin of the emulated world: latitude, longitude [deg], height [m], and the magnetic field,
# north-east-down [gauss], from PX4's own world model in 2026.
_ORIGIN = 47.397742, 8.545594, 488.0
_FIELD = np.array([0.2152, 0.0120, 0.4306])
_EARTH = 6371000.0  # [m], as in PX4's projection
_IMU_FIELDS, _MAG_FIELDS, _BARO_FIELDS = 0x3F, 0x1C0, 0x1A00
_GPS_EVERY, _SLOW_EVERY = 25, 5  # in HIL_SENSOR messages: 10 Hz, 50 Hz
_MAG_NOISE, _PRESSURE_NOISE = 0.002, 0.02  # [gauss], [hPa]
_GPS_NOISE = 0.02  # [m], [m/s]


class Controls(NamedTuple):
    """Thrust fractions that PX4 commands, and whether PX4 is armed.

    Attributes
    ----------
    shares : (16,) ndarray
        Commanded fraction of each rotor's largest thrust, 0 while PX4 is disarmed.
    """

    shares: Array
    is_armed: bool


class SimulatorLink:
    """TCP server to which PX4 connects as to its external simulator.

    Parameters
    ----------
    port : int
        TCP port.

    Attributes
    ----------
    is_lost : bool
        Whether a connected PX4 has ended or closed the connection.
    damaged : int
        Number of frames with a wrong checksum.

    Raises
    ------
    ValueError
        If the port is in use.
    """

    def __init__(self, port: int = SIMULATOR_PORT) -> None:
        self.is_lost = False
        self._reader = FrameReader()
        self._line: socket.socket | None = None
        self._door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._door.bind((HOST, port))
            self._door.listen(1)
        except OSError as error:
            self._door.close()
            raise ValueError(port_taken('TCP', port, error)) from None

    @property
    def damaged(self) -> int:
        """Number of received frames with a wrong checksum."""
        return self._reader.damaged

    def step(self, time_us: int, frames: Sequence[bytes], patience: float) -> Controls | None:
        """Send sensor frames; return PX4's answer within `patience` [s], or None.

        The last frame is the HIL_SENSOR of `time_us`. PX4 stamps every message with the time of its
        last HIL_SENSOR, so the frames before it get the previous time.
        """
        line = self._connected(patience)
        if line is None:
            return None
        try:
            line.sendall(b''.join(frames))
            return self._answer(line, time_us, time.monotonic() + patience)
        except OSError:
            self._lose()
            return None

    def close(self) -> None:
        """Close the line."""
        self._door.close()
        if self._line is not None:
            self._line.close()

    def _connected(self, patience: float) -> socket.socket | None:
        if self._line is None and not self.is_lost:
            if not select.select([self._door], [], [], patience)[0]:
                return None
            self._line, _ = self._door.accept()
            self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._line

    def _answer(self, line: socket.socket, time_us: int, deadline: float) -> Controls | None:
        while True:
            left = max(deadline - time.monotonic(), 0.0)
            if not select.select([line], [], [], left)[0]:
                return None
            data = line.recv(_CHUNK)
            if not data:
                self._lose()
                return None
            for message in self._reader.feed(data):
                if message.name == 'HIL_ACTUATOR_CONTROLS' and message['time_usec'] >= time_us:
                    return Controls(np.array(message['controls']), bool(message['mode'] & ARMED))

    def _lose(self) -> None:
        self.is_lost = True
        if self._line is not None:
            self._line.close()
        self._line = None


class SensorFrames:
    """Encodes sensor data for PX4, and emulates magnetometer, barometer and GPS receiver.

    Accelerometer, gyroscope and odometry keep the noise of their input. Magnetometer, barometer and
    GPS receiver get their own noise. PX4 treats equal IMU samples as a sensor fault. The samples of
    a held drone are equal, so `is_held` adds noise to the IMU.

    Parameters
    ----------
    sensors : str
        One of `px4.SENSORS`.
    """

    def __init__(self, sensors: str) -> None:
        self._writer = CompanionWriter()
        self._is_gps = sensors == GPS
        self._random = np.random.default_rng(0)
        self._count = 0
        self._before: FlightState | None = None
        self._before_us = 0

    def frames(
        self, time_us: int, state: FlightState, is_placed: bool = True, is_held: bool = False
    ) -> list[bytes]:
        """Return the sensor messages at `time_us` [us]: position first, then other sensors.

        The position is that of the previous sample, as odometry, or as a GPS reading in every 25th
        call. Without `is_placed` the position is left out.
        """
        frames = []
        if self._before is not None and is_placed:
            if not self._is_gps:
                frames.append(odometry_frame(self._writer, self._before_us, self._before))
            elif self._count % _GPS_EVERY == 0:
                frames.append(self._gps(self._before))
        frames.append(self._sensors(time_us, state, is_held))
        self._before, self._before_us = state, time_us
        self._count += 1
        return frames

    def _noise(self, deviation: float) -> Array:
        return deviation * self._random.standard_normal(3)

    def _sensors(self, time_us: int, state: FlightState, is_held: bool) -> bytes:
        level = GRAVITY * state.rotation[2]
        force = level if state.specific_force is None or is_held else state.specific_force
        rate = np.zeros(3) if is_held else state.rate
        if is_held:
            force, rate = force + self._noise(0.02), rate + self._noise(0.001)
        acceleration, rate = frd_to_flu(force), frd_to_flu(rate)
        values: dict[str, float] = dict(
            zip(('xacc', 'yacc', 'zacc'), acceleration.tolist(), strict=True)
        )
        values.update(zip(('xgyro', 'ygyro', 'zgyro'), rate.tolist(), strict=True))
        fields = _IMU_FIELDS
        if self._count % _SLOW_EVERY == 0:
            field = frd_rotation(state.rotation).T @ _FIELD + self._noise(_MAG_NOISE)
            values.update(zip(('xmag', 'ymag', 'zmag'), field.tolist(), strict=True))
            height = _ORIGIN[2] + float(state.position[2])
            pressure = 1013.25 * (1.0 - 2.25577e-5 * height) ** 5.25588
            values['abs_pressure'] = pressure + float(self._noise(_PRESSURE_NOISE)[0])
            values['pressure_alt'], values['temperature'] = height, 15.0
            fields |= _MAG_FIELDS | _BARO_FIELDS
        return self._writer.pack('HIL_SENSOR', time_usec=time_us, fields_updated=fields, **values)

    def _gps(self, state: FlightState) -> bytes:
        north, east, down = (ned(state.position) + self._noise(_GPS_NOISE)).tolist()
        velocity = 100.0 * (ned(state.velocity) + self._noise(_GPS_NOISE))
        vn, ve, vd = (int(value) for value in velocity.round())
        latitude, longitude, height = _ORIGIN
        shrunk = _EARTH * np.cos(np.radians(latitude))
        return self._writer.pack(
            'HIL_GPS', time_usec=self._before_us, fix_type=6,
            lat=round(1e7 * (latitude + np.degrees(north / _EARTH))),
            lon=round(1e7 * (longitude + np.degrees(east / shrunk))),
            alt=round(1e3 * (height - down)), eph=round(100 * _GPS_NOISE),
            epv=round(100 * _GPS_NOISE), vel=int(np.hypot(vn, ve)), vn=vn, ve=ve, vd=vd, cog=65535,
            satellites_visible=20,
        )  # fmt: skip


class Px4Firmware(LockstepFirmware):
    """Connection to PX4, which runs in lockstep with the simulation.

    PX4's clock is set by the stamps of the sensor messages. That clock continues while the
    simulation pauses and holds the drone. PX4's estimator and rotors need seconds to start.

    Parameters
    ----------
    sensors : str
        One of `px4.SENSORS`.
    """

    # PX4 takes off only toward a distant set point. PX4 would take the lift of a drone that does
    # not rise for its hover thrust, so the lift must soon exceed the weight.
    rise = 0.3
    _name, _system, _second, _settling = 'PX4', 0, 1e6, 2.0
    _averaged = 250  # 1 s
    _led, _mode_shift = 6, 16  # the main mode offboard
    _arms_on_set_points = True
    _worries = ('Arming denied', 'Preflight')

    def __init__(self, simulator: SimulatorLink, companion: UdpLine, sensors: str = VISION) -> None:
        super().__init__(companion, sensors)
        self._simulator = simulator
        self._frames = SensorFrames(sensors)
        self._time, self._beat_at, self._sent = float(STEP_US), 0.0, 0
        self._is_heard = False
        self._controls: Controls | None = None

    @classmethod
    def instance(cls, number: int, sensors: str = VISION) -> Px4Firmware:
        """Return the connection to PX4's instance `number`; raise ValueError if a port is used."""
        simulator = SimulatorLink(SIMULATOR_PORT + number)
        companion = companion_line(COMPANION_PORT + number, OFFBOARD_PORT + number)
        return cls(simulator, companion, sensors)

    @property
    def is_lost(self) -> bool:
        """Whether PX4 has ended or closed the connection."""
        return self._simulator.is_lost

    def close(self) -> None:
        """Close the connections."""
        self._simulator.close()
        self._companion.close()

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

    def _is_armed(self) -> bool:
        return self._controls is None or self._controls.is_armed

    def _take_off(self) -> None:
        """Do nothing, because the set points lead PX4 upward."""
