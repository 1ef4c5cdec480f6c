"""Client of an autopilot on a MAVLink connection: its state, message streams and commands."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.mavlink_line import (
    ARM,
    ARMED,
    AUTOPILOT,
    CUSTOM_MODE,
    SET_INTERVAL,
    SET_MODE,
    CompanionWriter,
    Line,
)
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.control.base.base_motion import (
    attitude_ned_frd_to_enu_flu,
    frd_to_flu,
    rotation_matrix,
)
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

LOSS = 1.5  # [s] without a heartbeat
FRESH = 0.2  # [s]; an older attitude or place is not used
_HEARTBEAT, _ASK = 1.0, 2.0  # [s] between heartbeats, and between requests of streams
PX4, ARDUPILOT = 'px4', 'ardupilot'
_FIRMWARES = {3: ARDUPILOT, 12: PX4}  # MAV_AUTOPILOT
_PX4_MODES = {
    1: 'manual', 2: 'altitude', 3: 'position', 4: 'auto', 5: 'acro', 6: 'offboard',
    7: 'stabilized', 8: 'rattitude', 9: 'simple', 10: 'termination',
}  # fmt: skip
_PX4_AUTO = {1: 'ready', 2: 'takeoff', 3: 'hold', 4: 'mission', 5: 'return', 6: 'land'}
_ARDUCOPTER_MODES = {
    0: 'stabilize', 1: 'acro', 2: 'altitude hold', 3: 'auto', 4: 'guided', 5: 'loiter',
    6: 'return', 7: 'circle', 9: 'land', 16: 'position hold', 17: 'brake', 20: 'guided without GPS',
    21: 'smart return',
}  # fmt: skip
_LED = {PX4: 6, ARDUPILOT: 4}  # custom mode that follows set points: offboard, guided
_RESULTS = (
    'accepted', 'temporarily rejected', 'denied', 'unsupported', 'failed', 'in progress',
    'cancelled',
)  # fmt: skip
_NUMBERS = {'attitude': 31, 'place': 32, 'imu': 105}  # message id of each stream
_OUTPUTS = {PX4: 375, ARDUPILOT: 36}
_STREAMS = {
    'ATTITUDE_QUATERNION': 'attitude', 'LOCAL_POSITION_NED': 'place', 'HIGHRES_IMU': 'imu',
    'ACTUATOR_OUTPUT_STATUS': 'outputs', 'SERVO_OUTPUT_RAW': 'outputs',
}  # fmt: skip
_SERVOS = [f'servo{number}_raw' for number in range(1, 17)]
_WORRYING = 4  # MAV_SEVERITY_WARNING; lower values are more severe


class ImuReading(NamedTuple):
    """Reading of the autopilot's IMU in forward-left-up axes.

    Attributes
    ----------
    rate, force : (3,) ndarray
        Angular velocity [rad/s] and specific force [m/s^2].
    """

    rate: Array
    force: Array


class MavlinkAutopilot:
    """Receives an autopilot's state over MAVLink, and requests the messages that the arm needs.

    The class sends set points and heartbeats. Only `arm`, `disarm` and `offboard` arm the autopilot
    or change its mode. All times `now` [s] are those of a monotonic clock.

    Parameters
    ----------
    rates : mapping
        Requested rates [Hz] of the streams `attitude`, `place`, `imu`, `outputs`; 0 for no
        request.

    Attributes
    ----------
    attitude : (4,) ndarray
        Attitude quaternion (x, y, z, w) of the forward-left-up body in the east-north-up world;
        None before the first.
    imu : ImuReading
        Newest IMU reading; None before the first.
    outputs : (32,) or (16,) ndarray
        Outputs of the motors in the autopilot's order, 32 of PX4 and 16 of ArduPilot; None before
        the first.
    text : str
        Last warning or error of the autopilot.
    reply : str
        Answer to the last command, '' before the first answer.
    """

    def __init__(self, line: Line, rates: dict[str, float]) -> None:
        self._line, self._rates = line, rates
        self._writer = CompanionWriter()
        self._system = 0
        self._heard = self._beat = self._asked = -np.inf
        self._times: dict[str, float] = {}  # of the newest message of each stream
        self._base_mode = self._custom_mode = self._make = 0
        self._place, self._velocity = np.zeros(3), np.zeros(3)
        self.attitude: Array | None = None
        self.imu: ImuReading | None = None
        self.outputs: Array | None = None
        self.text = self.reply = ''
        self._handlers: dict[str, Callable[[Message, float], None]] = {
            'HEARTBEAT': self._on_heartbeat,
            'ATTITUDE_QUATERNION': self._on_attitude,
            'LOCAL_POSITION_NED': self._on_place,
            'HIGHRES_IMU': self._on_imu,
            'ACTUATOR_OUTPUT_STATUS': self._on_outputs,
            'SERVO_OUTPUT_RAW': self._on_servos,
            'STATUSTEXT': self._on_text,
            'COMMAND_ACK': self._on_answer,
        }

    def take(self, message: Message, now: float) -> bool:
        """Process a message; return whether this autopilot sent it and its type is known."""
        handler = self._handlers.get(message.name)
        if handler is None or message.component != AUTOPILOT:
            return False
        if self._system not in (0, message.system):
            return False  # from another vehicle on the same line
        handler(message, now)
        if message.name in _STREAMS:
            self._times[_STREAMS[message.name]] = now
        return True

    def tick(self, now: float) -> None:
        """Send a heartbeat once per second, and request missing streams every 2 s."""
        if now - self._beat >= _HEARTBEAT:
            self._beat = now
            self._line.send(self._writer.heartbeat())
        if not self.is_linked(now):
            self._asked = -np.inf  # The autopilot may have restarted and lost the rates.
        elif now - self._asked >= _ASK:
            is_first, self._asked = self._asked == -np.inf, now
            numbers = {**_NUMBERS, 'outputs': _OUTPUTS.get(self.firmware, _OUTPUTS[PX4])}
            for name, number in numbers.items():
                rate = self._rates.get(name, 0.0)
                if rate > 0.0 and (is_first or self._age(name, now) > _ASK):
                    self._command(SET_INTERVAL, float(number), 1e6 / rate)

    def send(self, name: str, **values: object) -> None:
        """Send a MAVLink message to the autopilot."""
        self._line.send(self._writer.pack(name, **values))

    def set_point(self, name: str, now: float, **values: object) -> None:
        """Send the autopilot a set point, completed with time stamp and MAVLink address."""
        self.send(
            name, time_boot_ms=round(1e3 * now) % 2**32, target_system=self._system,
            target_component=AUTOPILOT, **values,
        )  # fmt: skip

    def arm(self) -> None:
        """Request that the autopilot arm."""
        self._request(ARM, 1.0)

    def disarm(self) -> None:
        """Request that the autopilot disarm; in flight the autopilot denies the request."""
        self._request(ARM, 0.0)

    def offboard(self) -> None:
        """Request the mode that follows set points: offboard (PX4) or guided (ArduPilot)."""
        self._request(SET_MODE, CUSTOM_MODE, _LED.get(self.firmware, _LED[PX4]))

    def is_linked(self, now: float) -> bool:
        """Return whether a heartbeat of the autopilot has arrived in the last 1.5 s."""
        return now - self._heard <= LOSS

    @property
    def is_armed(self) -> bool:
        """Whether the autopilot reports that it is armed."""
        return bool(self._base_mode & ARMED)

    @property
    def firmware(self) -> str:
        """Firmware number in the heartbeats: `PX4`, `ARDUPILOT` or another MAV_AUTOPILOT value."""
        return _FIRMWARES.get(self._make, f'MAV_AUTOPILOT {self._make}')

    @property
    def mode(self) -> str:
        """Name of the autopilot's flight mode, or the mode's number if its name is unknown."""
        unknown = f'custom mode {self._custom_mode}'
        if self.firmware == ARDUPILOT:
            return _ARDUCOPTER_MODES.get(self._custom_mode, unknown)
        if self.firmware != PX4:
            return unknown
        main, sub = self._custom_mode >> 16 & 0xFF, self._custom_mode >> 24 & 0xFF
        name = _PX4_MODES.get(main, f'mode {main}')
        return f'{name} {_PX4_AUTO[sub]}' if sub in _PX4_AUTO and name == 'auto' else name

    def state(self, now: float) -> FlightState | None:
        """Return the drone's pose and motion; None if attitude or position is out of date."""
        if not self.has_attitude(now) or self._age('place', now) > FRESH or self.attitude is None:
            return None
        rotation = rotation_matrix(self.attitude)
        return FlightState(self._place, self._velocity, rotation, self._rate)

    def has_attitude(self, now: float) -> bool:
        """Return whether the last attitude message is younger than 0.2 s."""
        return self._age('attitude', now) < FRESH

    def silent(self, now: float) -> list[str]:
        """Return the names of the requested messages that do not arrive."""
        return [name for name, rate in self._rates.items() if rate and self._age(name, now) > _ASK]

    def _age(self, stream: str, now: float) -> float:
        return now - self._times.get(stream, -np.inf)

    def _request(self, command: int, *parameters: float) -> None:
        self.reply = ''
        self._command(command, *parameters)

    def _command(self, command: int, *parameters: float) -> None:
        self._line.send(self._writer.command(self._system, command, *parameters))

    def _on_heartbeat(self, message: Message, now: float) -> None:
        self._system, self._heard = message.system, now
        self._base_mode, self._custom_mode = message['base_mode'], message['custom_mode']
        self._make = message['autopilot']

    def _on_attitude(self, message: Message, now: float) -> None:
        w, x, y, z = (message[name] for name in ('q1', 'q2', 'q3', 'q4'))
        quaternion = attitude_ned_frd_to_enu_flu([x, y, z, w])
        if not 0.9 < float(np.linalg.norm(quaternion)) < 1.1:  # also rejects NaN
            self.text = 'ATTITUDE_QUATERNION: the attitude contains NaN or is not a unit quaternion'
            return
        self.attitude = quaternion / np.linalg.norm(quaternion)
        self._rate = frd_to_flu([message[f'{axis}speed'] for axis in ('roll', 'pitch', 'yaw')])

    def _on_place(self, message: Message, now: float) -> None:
        place = np.array([message[axis] for axis in 'xyz'])
        velocity = np.array([message[f'v{axis}'] for axis in 'xyz'])
        if np.isfinite(place.sum() + velocity.sum()):
            self._place, self._velocity = ned(place), ned(velocity)

    def _on_imu(self, message: Message, now: float) -> None:
        rate = frd_to_flu([message[f'{axis}gyro'] for axis in 'xyz'])
        force = frd_to_flu([message[f'{axis}acc'] for axis in 'xyz'])
        if np.isfinite(rate.sum() + force.sum()):
            self.imu = ImuReading(rate, force)

    def _on_outputs(self, message: Message, now: float) -> None:
        self.outputs = np.array(message['actuator'])

    def _on_servos(self, message: Message, now: float) -> None:
        if message['port'] == 0:  # the other groups of outputs follow in separate messages
            self.outputs = np.array([message[name] for name in _SERVOS], dtype=float)

    def _on_text(self, message: Message, now: float) -> None:
        if message['severity'] <= _WORRYING:
            self.text = message['text']

    def _on_answer(self, message: Message, now: float) -> None:
        if message['command'] in (ARM, SET_MODE):
            result = message['result']
            self.reply = _RESULTS[result] if result < len(_RESULTS) else f'result {result}'
