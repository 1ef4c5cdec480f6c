"""Lockstep connection to the ArduCopter firmware (SITL), from its start to the flight."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.autopilot.ardupilot_link import JsonLink, sensor_line
from aerarm_ros.autopilot.firmware_flight import LockstepFirmware
from aerarm_ros.autopilot.mavlink_line import ARMED, SET_INTERVAL
from aerarm_ros.autopilot.px4 import VISION
from aerarm_ros.autopilot.px4_link import CompanionLink
from aerarm_ros.autopilot.px4_sensors import FRAME_LOCAL_FRD, odometry_frame
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.motion.signals import Array

_SAMPLE = 0.001  # [s] between two lines of sensor data
_HELD = 0.004  # [s] of one step while the drone is held
_SETTLED = 3.0  # [s] with a valid position before arming
_NEAR = 0.1  # [m] between ArduPilot's position and the odometry
_TAKE_OFF = 22  # MAV_CMD_NAV_TAKEOFF
_LOCAL_POSITION = 32
_ORIGIN = {'latitude': 473977420, 'longitude': 85455940, 'altitude': 488000}
_CLIMB = 1.0  # [m] of the take-off command above the held drone


class ArduPilotFirmware(LockstepFirmware):
    """Connection to ArduCopter, which runs in lockstep with the simulation.

    ArduCopter can arm without receiving set points.

    Parameters
    ----------
    rotors : sequence of int
        Rotor of each motor, see `ardupilot_setup.motors_of`.
    sensors : str
        One of `px4.SENSORS`; with GPS, ArduPilot simulates the receiver itself.
    """

    _name, _system, _second = 'ArduPilot', 1, 1.0
    _led = 4  # the mode guided

    def __init__(
        self,
        simulator: JsonLink,
        companion: CompanionLink,
        rotors: Sequence[int],
        sensors: str = VISION,
    ) -> None:
        super().__init__(simulator, companion)
        self._simulator = simulator
        self._motors = np.argsort(rotors)
        self._is_vision = sensors == VISION
        self._placed: float | None = None

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

    def _held_step(self, state: FlightState) -> Array | None:
        still = state._replace(velocity=np.zeros(3), rate=np.zeros(3), specific_force=None)
        return self.step(still, _HELD)

    def _has_settled(self, place: Array) -> bool:
        if self._is_due():
            self._command(SET_INTERVAL, _LOCAL_POSITION, 2e4)
            if self._is_vision:
                self.send('SET_GPS_GLOBAL_ORIGIN', target_system=1, **_ORIGIN)
        if self._place is None:
            return False
        if self._is_vision and np.linalg.norm(self._place - place) > _NEAR:
            self._placed = None
            return False
        self._placed = self._time if self._placed is None else self._placed
        if self._time - self._placed <= _SETTLED:
            return False
        self.origin = np.zeros(3) if self._is_vision else self._place - place
        return True

    def _is_armed(self) -> bool:
        return bool(self._flags & ARMED)

    def _take_off(self) -> None:
        if self._place is not None and self._is_due():
            self._command(_TAKE_OFF, *[0.0] * 6, _CLIMB - float(self._place[2]))
