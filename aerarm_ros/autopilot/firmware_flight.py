"""Simulated flight with an autopilot firmware (SITL) that runs in lockstep with the simulation."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from enum import Enum

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.ardupilot import ArduPilotSetPoints
from aerarm_ros.autopilot.mavlink import FrameWriter, Message
from aerarm_ros.autopilot.mavlink_line import (
    ARM,
    ARMED,
    AUTOPILOT,
    CUSTOM_MODE,
    HOST,
    SET_MODE,
    CompanionWriter,
    UdpLine,
    udp_socket,
)
from aerarm_ros.autopilot.px4 import GPS, Px4SetPoints, frd_rotation, ned
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array

_UP = np.array([0.0, 0.0, 1.0])
_PERIOD = 0.5  # [s] between two heartbeats, and between two requests to arm
_LOWERING = 2.0  # [s] in which the set point is lowered by `rise` without a step
_TEXTS = 50  # number of stored messages from the firmware


def companion_line(port: int, autopilot_port: int | None = None) -> UdpLine:
    """Return a UDP connection, as companion computer, to an autopilot on this host.

    Without the autopilot's port, the answers go where its messages come from. Raises ValueError if
    the own port is in use.
    """
    peer = None if autopilot_port is None else (HOST, autopilot_port)
    return UdpLine(peer, firmware_socket(port))


def firmware_socket(port: int) -> socket.socket:
    """Return a UDP socket on a port of this host; raise ValueError if the port is in use."""
    try:
        return udp_socket(HOST, port)
    except OSError as error:
        raise ValueError(port_taken('UDP', port, error)) from None


def port_taken(kind: str, port: int, error: OSError) -> str:
    """Return the error message for a port that cannot be opened."""
    return (
        f"{kind} port {port} for the autopilot's program cannot be opened ({error.strerror}): stop "
        'the other flight_control, simulator or ground station, or set another '
        'autopilot_instance'
    )


FRAME_LOCAL_NED, FRAME_LOCAL_FRD = 1, 20
"""Values of MAV_FRAME for odometry; PX4 requires the first, ArduPilot the second."""

_FRAME_BODY_FRD, _ESTIMATOR_VISION = 12, 2
_VARIANCES = (1e-4, 1e-4, 1e-4)  # position [m^2], attitude [rad^2], velocity [m^2/s^2] of vision


def odometry_frame(
    writer: FrameWriter, time_us: int, state: FlightState, frame: int = FRAME_LOCAL_NED
) -> bytes:
    """Return an ODOMETRY message: pose in the axes of `frame`, velocity in body axes (FRD)."""
    x, y, z = ned(state.position).tolist()
    qx, qy, qz, qw = pin.Quaternion(frd_rotation(state.rotation)).coeffs().tolist()
    vx, vy, vz = frd_to_flu(state.rotation.T @ state.velocity).tolist()
    p, q, r = frd_to_flu(state.rate).tolist()
    place, turn, speed = _VARIANCES
    return writer.pack(
        'ODOMETRY', time_usec=time_us, frame_id=frame, child_frame_id=_FRAME_BODY_FRD, x=x, y=y,
        z=z, q=(qw, qx, qy, qz), vx=vx, vy=vy, vz=vz, rollspeed=p, pitchspeed=q, yawspeed=r,
        pose_covariance=_diagonal(place, turn), velocity_covariance=_diagonal(speed, speed),
        estimator_type=_ESTIMATOR_VISION, quality=100,
    )  # fmt: skip


def _diagonal(first: float, second: float) -> list[float]:
    """Return the upper triangle (21,) of a diagonal 6 by 6 covariance matrix."""
    rows = np.diag([first] * 3 + [second] * 3)
    return [float(value) for value in rows[np.triu_indices(6)]]


class FlightStage(Enum):
    """Stage of a firmware's start and take-off; each value is a status text for its name."""

    BOOT = 'no answer from {0} yet: start {0} before this node, as instance autopilot_instance'
    SETTLE = "{0}'s estimator is settling"
    ARM = '{0} is arming'
    SPOOL = "{0}'s rotors are spooling up"
    FLY = ''


class LockstepFirmware(ABC):
    """Connection to an autopilot firmware on this host that runs in lockstep with the simulation.

    The simulation holds the drone until the thrust of the firmware's rotors can carry it.

    Parameters
    ----------
    companion
        Connection to the firmware as a companion computer.
    sensors : str
        One of `px4.SENSORS`, the source of the firmware's position.

    Attributes
    ----------
    texts : list of str
        Messages of the firmware, the newest last, such as rejections of set points.
    origin : (3,) ndarray
        Origin of the world in the firmware's local frame, east-north-up [m].
    rise : float
        Height [m] above the held drone to which the first set points lead it.
    """

    rise = 0.0
    _name: str
    _system: int  # MAVLink id of the firmware, 0 for any
    _second: float  # unit of `_time`
    _led: int  # mode that follows set points
    _mode_shift = 0  # bit of the custom mode at which the mode begins
    _arms_on_set_points = False
    _settling: float  # [s] with a position near the true one before arming
    _near = np.inf  # [m] between the firmware's position and the true one, without GPS
    _averaged = 1  # number of positions whose mean error is `origin`, with GPS
    # A message that contains one of these is shown before the flight.
    _worries: tuple[str, ...] = ('',)

    def __init__(self, companion: UdpLine, sensors: str) -> None:
        self._companion = companion
        self._is_gps = sensors == GPS
        self._writer = CompanionWriter()
        self._time = 0.0
        self._asked = self._beat_at = -1.0
        self._place: Array | None = None
        self._placed: float | None = None  # time since which the position is near the true one
        self._offsets: list[Array] = []  # errors of the position while the firmware settles
        self._mode = self._flags = 0
        self.origin = np.zeros(3)
        self.stage = FlightStage.BOOT
        self.texts: list[str] = []

    @property
    @abstractmethod
    def is_lost(self) -> bool:
        """Whether the firmware has ended."""

    @property
    def problem(self) -> str:
        """Reason why the firmware does not fly the drone; empty while the firmware flies it."""
        name = self._name
        if self.is_lost:
            return f'{name} has ended: restart {name} and this node'
        if not self.is_flying:
            newest = self.texts[-3:]
            texts = [text for text in newest if any(worry in text for worry in self._worries)]
            return '; '.join([self.stage.value.format(name), *texts])
        return '' if self._is_armed() else f'{name} has disarmed: ' + '; '.join(self.texts[-2:])

    @property
    def is_flying(self) -> bool:
        """Whether the simulation has released the drone."""
        return self.stage is FlightStage.FLY

    @property
    def is_led(self) -> bool:
        """Whether the firmware is in the mode that follows set points."""
        return self._mode == self._led

    @property
    def wants_set_points(self) -> bool:
        """Whether the firmware needs set points while the simulation holds the drone."""
        return self._arms_on_set_points and self.stage in (FlightStage.ARM, FlightStage.SPOOL)

    @property
    def time_ms(self) -> int:
        """Present time on the clock of the firmware [ms]."""
        return round(1e3 * self._time / self._second)

    def send(self, name: str, **values: object) -> None:
        """Send a MAVLink message to the firmware."""
        self._companion.send(self._writer.pack(name, **values))

    @abstractmethod
    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance the firmware by `dt` [s]; return thrust fractions, None without an answer."""

    def hold(self, state: FlightState, lift: float) -> Array | None:
        """Advance the firmware a step with the drone held in place; return thrust fractions.

        `lift` is the sum of the rotors' thrust fractions that carries the drone. The result is None
        without an answer.
        """
        shares = self._held_step(state)
        if self.stage is FlightStage.SETTLE:
            if self._has_settled(ned(state.position)):
                self.stage = FlightStage.ARM
        elif self.stage is FlightStage.ARM:
            self._ask()
        elif shares is None:
            return None
        elif self.stage is FlightStage.BOOT:
            self.stage = FlightStage.SETTLE
        elif self.stage is FlightStage.SPOOL:
            if not self._is_armed():
                self.stage = FlightStage.ARM
            elif float(shares.sum()) > lift:
                self.stage = FlightStage.FLY
            else:
                self._take_off()
        return shares

    @abstractmethod
    def _held_step(self, state: FlightState) -> Array | None:
        """Advance the firmware by a step with the drone at rest; return thrust fractions."""

    def _has_settled(self, place: Array) -> bool:
        """Return whether the firmware has long known its position, the true one (NED) [m]."""
        if self._place is None:
            return False
        offset = self._place - place
        if not self._is_gps and np.linalg.norm(offset) > self._near:
            self._placed = None
            return False
        self._placed = self._time if self._placed is None else self._placed
        self._offsets.append(offset)
        if self._time - self._placed <= self._settling * self._second:
            return False
        if self._is_gps:  # otherwise the firmware's frame is that of the odometry
            self.origin = ned(np.mean(self._offsets[-self._averaged :], axis=0))
        return True

    def _is_armed(self) -> bool:
        """Return whether the firmware is armed and drives its rotors."""
        return bool(self._flags & ARMED)

    @abstractmethod
    def _take_off(self) -> None:
        """Request the take-off if the firmware needs a request."""

    def _ask(self) -> None:
        """Request the mode, then arming, every 0.5 s until the firmware is armed."""
        if self._flags & ARMED and self.is_led:
            self.stage = FlightStage.SPOOL
        elif self._is_due():
            if self.is_led:
                self._command(ARM, 1.0)
            else:
                self._command(SET_MODE, CUSTOM_MODE, self._led)

    def _is_due(self) -> bool:
        """Return whether 0.5 s have passed since the last request to the firmware."""
        if self._time - self._asked < _PERIOD * self._second:
            return False
        self._asked = self._time
        return True

    def _command(self, command: int, *parameters: float) -> None:
        self._companion.send(self._writer.command(self._system, command, *parameters))

    def _beat(self) -> None:
        if self._time - self._beat_at > _PERIOD * self._second:
            self._beat_at = self._time
            self._companion.send(self._writer.heartbeat())

    def _take(self, message: Message) -> None:
        if message.name == 'HEARTBEAT' and message.component == AUTOPILOT:
            self._mode = message['custom_mode'] >> self._mode_shift & 0xFF
            self._flags = message['base_mode']
        elif message.name == 'LOCAL_POSITION_NED':
            self._place = np.array([message['x'], message['y'], message['z']])
        elif message.name == 'STATUSTEXT':
            self.texts = [*self.texts[1 - _TEXTS :], message['text']]


class FirmwareFlight:
    """Flight control by an autopilot firmware that follows set points, instead of `FlightControl`.

    Parameters
    ----------
    body : MassProperties
        Mass properties of drone and arm at rest.
    firmware : LockstepFirmware
        Connection to the firmware.
    set_points : Px4SetPoints or ArduPilotSetPoints
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
        set_points: Px4SetPoints | ArduPilotSetPoints,
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
        elif dt > 0.0:  # otherwise this is the state at the take-off
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
        origin = self._firmware.origin
        state = state._replace(position=state.position + origin)
        above = target._replace(position=target.position + origin + self._above * _UP)
        name, values = self._set_points.message(state, above, dt, arm)
        self._firmware.send(name, time_boot_ms=self._firmware.time_ms, **values)
