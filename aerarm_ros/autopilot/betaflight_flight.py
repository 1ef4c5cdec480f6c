"""Simulated flight with the Betaflight firmware (SITL), which receives stick positions over UDP.

The layouts of packets are those of `src/platform/SIMULATOR/target/SITL/target.h` of Betaflight 4.6,
little endian, as a C compiler for 64 bits lays them out.
"""

import select
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.firmware_flight import firmware_socket
from aerarm_ros.autopilot.mavlink_line import HOST
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightGains, PositionLoop
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.motion.signals import Array, limited

MOTOR_PORT, STATE_PORT, RC_PORT = 9001, 9003, 9004
"""UDP ports of Betaflight for motor outputs, drone state and sticks.

Port 9002 sends only the first four motor outputs.
"""

CHANNELS, MOTORS = 16, 16
LOW, MIDDLE, HIGH = 1000, 1500, 2000
"""Lowest, middle and highest pulse length [us] of a stick or motor."""

_STATE = struct.Struct('<d 3d 3d 4d 3d 3d d')
_RC = struct.Struct(f'<d {CHANNELS}H')
_MOTORS = struct.Struct(f'<H 2x {MOTORS}f')
_PRESSURE = 101325.0  # [Pa]; no used function depends on it


def state_packet(rate: Array, force: Array, rotation_wxyz: Array) -> bytes:
    """Return the UDP packet that sends Betaflight the state of the simulated drone.

    All packets carry the same stamp. From different stamps and their arrival times, the firmware
    would derive the speed of its clock. On a busy host that clock could run hundreds of times too
    fast.

    The firmware reverses y and z of the angular velocity and all axes of the acceleration, and
    uses forward-left-up axes. The firmware expects the attitude with y and z of body and world
    reversed.

    Parameters
    ----------
    rate, force : (3,) ndarray
        Angular velocity [rad/s] and specific force [m/s^2] in forward-left-up axes.
    rotation_wxyz : (4,) ndarray
        Attitude (w, x, y, z), body to world.
    """
    x, y, z = rate.tolist()
    nowhere = [0.0] * 6  # position, for the firmware's GPS only
    w, qx, qy, qz = rotation_wxyz.tolist()
    attitude = w, qx, -qy, -qz
    return _STATE.pack(0.0, x, -y, -z, *(-force).tolist(), *attitude, *nowhere, _PRESSURE)


def rc_packet(channels: Sequence[int]) -> bytes:
    """Return the UDP packet of the channels [us] roll, pitch, throttle, yaw, AUX1 and so on."""
    return _RC.pack(0.0, *channels, *[LOW] * (CHANNELS - len(channels)))


def motor_outputs(packet: bytes) -> Array | None:
    """Return the pulse lengths (n,) [us] of a motor packet, None for other packets."""
    if len(packet) != _MOTORS.size:
        return None
    count, *outputs = _MOTORS.unpack(packet)
    if not 0 < count <= MOTORS:
        return None
    pulses = np.array(outputs[:count])
    return pulses if np.all(np.isfinite(pulses)) else None


_ANSWER = 0.02  # [s] longest wait for an answer on a busy host


class BetaflightLink:
    """UDP connection that sends states and sticks to Betaflight, and receives motor pulses.

    Parameters
    ----------
    motor_port, state_port, rc_port : int
        UDP ports.

    Raises
    ------
    ValueError
        If the port of the motors is in use.
    """

    def __init__(
        self, motor_port: int = MOTOR_PORT, state_port: int = STATE_PORT, rc_port: int = RC_PORT
    ) -> None:
        self._state_port, self._rc_port = state_port, rc_port
        self._motors = firmware_socket(motor_port)
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._motors.setblocking(False)

    def exchange(
        self, channels: Sequence[int], rate: Array, force: Array, rotation_wxyz: Array
    ) -> Array | None:
        """Send sticks and drone state; return the latest motor pulses (n,) [us], or None."""
        late = self._newest()  # the late answer to the previous state, on a busy host
        state = state_packet(rate, force, rotation_wxyz)
        self._sender.sendto(rc_packet(channels), (HOST, self._rc_port))
        self._sender.sendto(state, (HOST, self._state_port))
        select.select([self._motors], [], [], _ANSWER)
        answer = self._newest()
        return late if answer is None else answer

    def close(self) -> None:
        """Close the sockets."""
        self._sender.close()
        self._motors.close()

    def _newest(self) -> Array | None:
        newest = None
        while True:
            try:
                packet = self._motors.recv(256)
            except (BlockingIOError, ConnectionRefusedError):
                return newest
            outputs = motor_outputs(packet)
            newest = newest if outputs is None else outputs


# Roll, pitch and yaw of each motor, as in flight/mixer_init.c; and the mixer's name.
_MIXERS: dict[int, tuple[str, list[tuple[float, float, float]]]] = {
    4: ('QUADX', [(-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1)]),
    6: (
        'HEX6X',
        [
            (-0.5, 0.866025, 1),
            (-0.5, -0.866025, 1),
            (0.5, 0.866025, -1),
            (0.5, -0.866025, -1),
            (-1, 0, -1),
            (1, 0, 1),
        ],
    ),
}
_P_SCALE, _I_SCALE = 0.032029, 0.244381  # flight/pid.h: per deg/s, and per degree
_SUM_SCALE = 1000.0
_LOW = 1010  # [us] below which the throttle is off
_NEAR = 0.2  # largest distance between a rotor and its place in the mixer, relative


@dataclass(frozen=True)
class BetaflightSetup:
    """Settings of Betaflight in angle mode: gains, limits and a linear response to the sticks.

    Attributes
    ----------
    p, i : int
        Gains of the angular-velocity loops of roll and pitch, in Betaflight's units. D is zero,
        because the emulated gyroscope is too slow.
    angle_gain : int
        Betaflight's `angle_p_gain` [0.1/s].
    angle_limit : float
        Roll or pitch angle at full stick [deg].
    yaw_rate : float
        Angular velocity about the vertical at full stick [deg/s].
    idle : float
        Output of an armed idle motor as a fraction of the full output.
    """

    p: int = 200
    i: int = 36
    angle_gain: int = 80
    angle_limit: int = 40
    yaw_rate: int = 120
    idle: float = 0.055

    def throttle(self, share: float) -> int:
        """Return the throttle pulse [us] at which each motor gives this fraction of thrust."""
        part = min(max((share - self.idle) / (1.0 - self.idle), 0.0), 1.0)
        return round(_LOW + part * (HIGH - _LOW))

    def motors_of(self, drone: DroneConfig) -> list[int]:
        """Return the motor number of each rotor; raise ValueError if no mixer fits the drone."""
        motors = mixer_of(drone)[1]
        return [motors.index(rotor) for rotor in range(drone.n)]

    @property
    def attitude_gain(self) -> float:
        """Gain of the attitude loop, angular velocity per attitude error [1/s]."""
        return 0.1 * self.angle_gain

    def rate_gain(self, drone: DroneConfig) -> float:
        """Return the roll or pitch loop's moment per angular velocity error [Nm s/rad]."""
        name, order = mixer_of(drone)
        shares = np.array(_MIXERS[drone.n][1])[:, :2]
        places = np.array([drone.rotors[rotor].position for rotor in order])
        most = np.array([drone.rotors[rotor].thrust_max for rotor in order])
        levers = np.column_stack([places[:, 1], -places[:, 0]])
        moment = float(np.sum(most[:, np.newaxis] * levers * shares, axis=0).mean())
        per_sum = self.p * _P_SCALE * np.degrees(1.0) / _SUM_SCALE
        return float((1.0 - self.idle) * per_sum * moment)

    @property
    def integral_rate(self) -> float:
        """Integral gain divided by the proportional gain of the angular-velocity loop [1/s]."""
        return self.i * _I_SCALE / (self.p * _P_SCALE)


def mixer_of(drone: DroneConfig) -> tuple[str, list[int]]:
    """Return the name of Betaflight's mixer for a drone, and the rotor number of each motor."""
    if drone.is_fully_actuated or drone.n not in _MIXERS:
        raise ValueError(
            f"loops 'betaflight': {drone.name} is not a quadrotor or hexarotor with its rotors "
            'in one plane and in X form; choose other loops'
        )
    name, motors = _MIXERS[drone.n]
    places = np.array([rotor.position for rotor in drone.rotors])
    levers = np.column_stack([places[:, 1], -places[:, 0]])
    levers = levers / np.abs(levers[:, 0]).max()
    turns = -np.sign([rotor.moment_per_thrust for rotor in drone.rotors])
    order = []
    for roll, pitch, yaw in motors:
        distances = np.linalg.norm(levers - [roll, pitch], axis=1)
        rotor = int(np.argmin(distances))
        if distances[rotor] > _NEAR or turns[rotor] != yaw:
            raise ValueError(
                f"loops 'betaflight': {drone.name} has no rotor where the mixer {name} expects "
                'one, or the rotor turns the other way; check rotors in the drone file'
            )
        order.append(rotor)
    return name, order


_UP = np.array([0.0, 0.0, 1.0])
_HEADING = 1.5  # [1/s] angular velocity per error of the heading
_TRY, _PAUSE = 3.0, 0.5  # [s] for which the arming switch is on, and off in between
_SILENCE = 0.5  # [s] without motor outputs
_SINK = 0.97  # lifted fraction of the weight without a known height


class BetaflightFlight:
    """Position control by stick commands to Betaflight in angle mode, instead of `FlightControl`.

    The sticks command roll, pitch, the angular velocity about the vertical, and throttle. The
    position loop uses the mass of drone and arm. The arm's motion is fed forward by the
    acceleration of `SetPointAcceleration`, and the arm's mass by the throttle. The class arms the
    firmware before the flight, some seconds after the firmware's start.

    Parameters
    ----------
    body : MassProperties
        Default mass properties of drone and arm.
    gains : FlightGains, optional
        Gains and limits of the position loop.
    setup : BetaflightSetup, optional
        Setup of the firmware.

    Attributes
    ----------
    problem : str
        Reason why the rotors are not commanded; empty if they are.

    Raises
    ------
    ValueError
        If Betaflight has no mixer for this drone.
    """

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        firmware: BetaflightLink,
        gains: FlightGains | None = None,
        setup: BetaflightSetup | None = None,
    ) -> None:
        self._setup = setup = BetaflightSetup() if setup is None else setup
        self._gains = FlightGains() if gains is None else gains
        self._loop = PositionLoop(self._gains)
        self._motors = setup.motors_of(drone)
        self._thrust_max = drone.column('thrust_max')
        self._firmware = firmware
        self._at_rest = FeedForward.at_rest(body)
        self._acceleration = SetPointAcceleration(
            setup.attitude_gain, setup.rate_gain(drone), setup.integral_rate, ignores_lift=False
        )
        self.reset()

    def reset(self) -> None:
        """Reset the integral of the position loop, and the arming state."""
        self._loop.reset()
        self._switched = 0.0
        self._silence = np.inf
        self._thrust = np.zeros(len(self._thrust_max))
        self._is_armed = False
        self.problem = 'no data from Betaflight: start Betaflight before this node'

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the rotors' thrusts (n,) [N] that move the drone to the target."""
        arm = self._at_rest if arm is None else arm
        feedback = self._loop.update(state, target, dt if self._is_armed else 0.0)
        fed = self._acceleration.update(arm, state.rotation, dt)
        force = arm.body.mass * (target.acceleration + feedback + fed + GRAVITY * _UP)
        turn = target.yaw - yaw_of(state.rotation)
        return self._fly(state, force, float(np.arctan2(np.sin(turn), np.cos(turn))), dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return thrusts (n,) [N] for a level descent, used if the position is unknown."""
        return self._fly(state, _SINK * self._at_rest.body.mass * GRAVITY * _UP, 0.0, dt)

    def _fly(self, state: FlightState, force: Array, turn: float, dt: float) -> Array:
        channels = [MIDDLE, MIDDLE, LOW, MIDDLE]
        if self._is_armed:
            channels = self._sticks(state, force, turn)
        switch = HIGH if self._is_armed or self._switched > _PAUSE else LOW
        w_last = pin.Quaternion(state.rotation).coeffs()
        felt = state.specific_force
        felt = GRAVITY * state.rotation[2] if felt is None else felt
        sticks = [*channels, switch, HIGH]
        pulses = self._firmware.exchange(sticks, state.rate, felt, np.roll(w_last, 1))
        self._silence = self._silence + dt if pulses is None else 0.0
        if pulses is not None and len(pulses) == len(self._motors):
            shares = np.clip((pulses[self._motors] - LOW) / (HIGH - LOW), 0.0, 1.0)
            self._thrust = shares * self._thrust_max
            self._note_outputs(float(shares.min()), dt)
        if _SILENCE < self._silence < np.inf:
            self.reset()
        return self._thrust

    def _note_outputs(self, least: float, dt: float) -> None:
        """Detect from the motor outputs whether the firmware is armed."""
        self._is_armed = least > 0.5 * self._setup.idle
        self._switched = (self._switched + dt) % (_TRY + _PAUSE)
        self.problem = '' if self._is_armed else 'Betaflight is arming'

    def _sticks(self, state: FlightState, force: Array, turn: float) -> list[int]:
        """Return the stick positions roll, pitch, throttle, yaw for a force in world axes."""
        setup, heading = self._setup, yaw_of(state.rotation)
        lift = max(force[2], 0.2 * self._at_rest.body.mass * GRAVITY)
        sideways = limited(force[:2], lift * float(np.tan(self._gains.tilt_max)))
        along = pin.exp3(-heading * _UP) @ np.append(sideways, lift)
        thrust = float(np.append(sideways, lift) @ state.rotation[:, 2])
        x, y, z = along / np.linalg.norm(along)
        roll, pitch = np.degrees([-np.arcsin(y), np.arctan2(x, z)]) / setup.angle_limit
        yaw = -np.degrees(_HEADING * turn) / setup.yaw_rate  # positive to the right
        throttle = setup.throttle(thrust / float(self._thrust_max.sum()))
        return [_pulse(roll), _pulse(pitch), throttle, _pulse(yaw)]


def _pulse(share: float) -> int:
    """Return the pulse length [us] that encodes a stick position from -1 to 1."""
    return round(MIDDLE + 500.0 * min(max(share, -1.0), 1.0))
