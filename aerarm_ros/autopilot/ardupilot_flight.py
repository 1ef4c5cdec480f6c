"""Simulated flight with the ArduCopter firmware (SITL), with feedforward of the arm's motion."""

from collections.abc import Sequence
from enum import Enum

import numpy as np

from aerarm_ros.autopilot.ardupilot_link import JsonSimulator, sensor_line
from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.px4_link import COMPANION, Companion, companion_writer
from aerarm_ros.autopilot.px4_sensors import FRAME_LOCAL_FRD, odometry_frame
from aerarm_ros.autopilot.px4_setup import VISION
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

_SAMPLE = 0.001  # [s] between two lines of sensor data
_HELD = 0.004  # [s] of one step while the drone is held
_SETTLED = 3.0  # [s] with a valid position before arming
_NEAR = 0.1  # [m] between ArduPilot's position and the odometry
_ASK_EVERY, _HEARTBEAT = 0.5, 0.5  # [s]
_GUIDED, _ARMED, _CUSTOM_MODE = 4, 128, 1
_SET_MODE, _ARM, _TAKE_OFF, _SET_INTERVAL = 176, 400, 22, 511
_LOCAL_POSITION = 32
_ORIGIN = {'latitude': 473977420, 'longitude': 85455940, 'altitude': 488000}
_CLIMB = 1.0  # [m] of the take-off command above the held drone
_TEXTS = 50


class ArduPilotStage(Enum):
    """Stage of ArduPilot's start and take-off; each value is the status text for the user."""

    BOOT = 'no answer from ArduPilot yet: start ArduPilot as instance autopilot_instance'
    SETTLE = "ArduPilot's estimator is settling"
    ARM = 'ArduPilot is arming'
    SPOOL = "ArduPilot's rotors are spooling up"
    FLY = ''


class ArduPilotFirmware:
    """Connection to ArduCopter, which runs in lockstep with the simulation.

    The simulation holds the drone until the thrust of ArduCopter's rotors can carry it.

    Parameters
    ----------
    simulator, companion
        Connections to ArduPilot, as its simulator and as a companion computer.
    rotors : sequence of int
        Rotor of each motor, see `ardupilot_setup.motors_of`.
    sensors : str
        One of `px4_setup.SENSORS`; with GPS, ArduPilot simulates the receiver itself.

    Attributes
    ----------
    texts : list of str
        Messages of ArduPilot, the newest last.
    origin : (3,) ndarray
        Origin of ArduPilot's local frame in the world, north-east-down [m].
    rise : float
        Height [m] above the held drone to which the first set points lead it.
    """

    def __init__(
        self,
        simulator: JsonSimulator,
        companion: Companion,
        rotors: Sequence[int],
        sensors: str = VISION,
    ) -> None:
        self._simulator, self._companion = simulator, companion
        self._motors = np.argsort(rotors)
        self._writer = companion_writer()
        self._is_vision = sensors == VISION
        self._time = 0.0
        self._asked = self._beat_at = -1.0
        self._place: Array | None = None
        self._placed: float | None = None
        self._mode = self._flags = 0
        self.stage = ArduPilotStage.BOOT
        self.texts: list[str] = []
        self.origin = np.zeros(3)
        self.rise = 0.0

    @property
    def problem(self) -> str:
        """Reason why ArduPilot does not fly the drone; empty while ArduPilot flies it."""
        if self._simulator.is_lost:
            return 'ArduPilot has ended: restart ArduPilot and this node'
        if self.stage is not ArduPilotStage.FLY:
            return '; '.join([self.stage.value, *self.texts[-2:]])
        if not self._flags & _ARMED:
            return 'ArduPilot has disarmed: ' + '; '.join(self.texts[-2:])
        return ''

    @property
    def is_flying(self) -> bool:
        """Whether the simulation has released the drone."""
        return self.stage is ArduPilotStage.FLY

    @property
    def wants_set_points(self) -> bool:
        """Always False, because ArduCopter can arm without receiving set points."""
        return False

    @property
    def time_ms(self) -> int:
        """ArduPilot's time [ms]."""
        return round(1e3 * self._time)

    def send(self, name: str, **values: object) -> None:
        """Send a MAVLink message to ArduPilot."""
        self._companion.send(self._writer.pack(name, **values))

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance ArduPilot by `dt` [s]; return n thrust fractions, None without an answer.

        ArduPilot reads its gyroscopes at 1 kHz, so it gets several equal samples per step.
        """
        self._beat()
        if is_placed and self._is_vision:
            self._companion.send(
                odometry_frame(self._writer, round(1e6 * self._time), state, FRAME_LOCAL_FRD)
            )
        count = max(round(dt / _SAMPLE), 1)
        ends = self._time + dt * np.arange(1, count + 1) / count
        answer = self._simulator.step([sensor_line(float(end), state) for end in ends])
        if answer is not None:
            self._time = float(ends[-1])
            answer = answer[self._motors]
        for message in self._companion.messages():
            self._take(message)
        return answer

    def hold(self, state: FlightState, lift: float) -> Array | None:
        """Advance ArduPilot by a step with the drone held in place; return thrust fractions.

        `lift` is the sum of the rotors' thrust fractions that carries the drone.
        """
        still = state._replace(velocity=np.zeros(3), rate=np.zeros(3), specific_force=None)
        shares = self.step(still, _HELD)
        if self.stage is ArduPilotStage.BOOT and shares is not None:
            self.stage = ArduPilotStage.SETTLE
        elif self.stage is ArduPilotStage.SETTLE:
            self._settle(ned(state.position))
        elif self.stage is ArduPilotStage.ARM:
            self._ask()
        elif self.stage is ArduPilotStage.SPOOL and shares is not None:
            if not self._flags & _ARMED:
                self.stage = ArduPilotStage.ARM
            elif float(shares.sum()) > lift:
                self.stage = ArduPilotStage.FLY
            elif self._place is not None and self._is_due():
                self._command(_TAKE_OFF, param7=_CLIMB - float(self._place[2]))
        return shares

    def _settle(self, place: Array) -> None:
        if self._is_due():
            self._command(_SET_INTERVAL, param1=_LOCAL_POSITION, param2=2e4)
            if self._is_vision:
                self.send('SET_GPS_GLOBAL_ORIGIN', target_system=1, **_ORIGIN)
        if self._place is None:
            return
        if self._is_vision and np.linalg.norm(self._place - place) > _NEAR:
            self._placed = None
            return
        self._placed = self._time if self._placed is None else self._placed
        if self._time - self._placed > _SETTLED:
            self.origin = np.zeros(3) if self._is_vision else self._place - place
            self.stage = ArduPilotStage.ARM

    def _ask(self) -> None:
        """Request guided mode, then arming, every 0.5 s until ArduPilot is armed."""
        if self._flags & _ARMED and self._mode == _GUIDED:
            self.stage = ArduPilotStage.SPOOL
        elif self._is_due():
            if self._mode != _GUIDED:
                self._command(_SET_MODE, param1=_CUSTOM_MODE, param2=_GUIDED)
            else:
                self._command(_ARM, param1=1.0)

    def _is_due(self) -> bool:
        """Return whether 0.5 s have passed since the last request to ArduPilot."""
        if self._time - self._asked < _ASK_EVERY:
            return False
        self._asked = self._time
        return True

    def _command(self, command: int, **parameters: float) -> None:
        self.send(
            'COMMAND_LONG', target_system=1, target_component=1, command=command, **parameters
        )

    def _beat(self) -> None:
        if self._time - self._beat_at > _HEARTBEAT:
            self._beat_at = self._time
            self.send('HEARTBEAT', **COMPANION)

    def _take(self, message: Message) -> None:
        if message.name == 'HEARTBEAT' and message.component == 1:
            self._mode, self._flags = message['custom_mode'], message['base_mode']
        elif message.name == 'LOCAL_POSITION_NED':
            self._place = np.array([message['x'], message['y'], message['z']])
        elif message.name == 'STATUSTEXT':
            self.texts = [*self.texts[1 - _TEXTS :], message['text']]
