"""How a Betaflight is set up so that it flies a drone with its arm."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.autopilot.betaflight_packets import HIGH
from aerarm_ros.description.drone_config import DroneConfig

Array = npt.NDArray[np.float64]

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
_LOW = 1010  # [us] below it the throttle is off
_NEAR = 0.2  # of the largest distance, between a rotor and where the mixer has it


@dataclass(frozen=True)
class BetaflightSetup:
    """Gains and limits of a Betaflight in angle mode, with sticks that are linear.

    Attributes
    ----------
    p, i : int
        Of roll and pitch, in its units. There is no D: the emulated gyroscope comes too seldom.
    angle_gain : int
        angle_p_gain, tenths of 1/s.
    angle_limit : float
        At full stick [deg].
    yaw_rate : float
        At full stick [deg/s].
    idle : float
        Share of the full output at which an armed motor idles.
    """

    p: int = 200
    i: int = 36
    angle_gain: int = 80
    angle_limit: int = 40
    yaw_rate: int = 120
    idle: float = 0.055

    def commands(self, drone: DroneConfig) -> list[str]:
        """Return what is typed into its command line, but `save`; raises ValueError."""
        rates = [
            f'set {axis}_{what} = {value}'
            for axis, rate in (('roll', 36), ('pitch', 36), ('yaw', self.yaw_rate // 10))
            for what, value in (('rc_rate', rate), ('srate', rate), ('expo', 0))
        ]
        gains = [
            f'set {what}_{axis} = {value}'
            for axis in ('roll', 'pitch')
            for what, value in (('p', self.p), ('i', self.i), ('d', 0), ('d_max', 0), ('f', 0))
        ]
        yaw = ['set p_yaw = 60', 'set i_yaw = 20', 'set f_yaw = 0']
        settings = {
            'simplified_pids_mode': 'OFF',
            'motor_idle': round(1e4 * self.idle),
            'angle_p_gain': self.angle_gain,
            'angle_limit': self.angle_limit,
            'angle_feedforward': 0,
            'min_check': _LOW,
            'rc_smoothing': 'OFF',
            'iterm_relax': 'OFF',
            'pidsum_limit': 1000,
            # More would bring rotors to idle, which lifts the drone.
            'pidsum_limit_yaw': 200,
            'throttle_boost': 0,
            'tpa_rate': 0,
            'anti_gravity_gain': 0,
            'small_angle': 180,
        }
        return [
            f'mixer {_mixer(drone)[0]}',
            'feature -ANTI_GRAVITY',
            'aux 0 0 0 1700 2100 0 0',  # ARM by AUX1
            'aux 1 1 1 900 2100 0 0',  # ANGLE by AUX2, always
            *(f'set {name} = {value}' for name, value in settings.items()),
            *gains,
            *yaw,
            *rates,
        ]

    def throttle(self, share: float) -> int:
        """Return the stick [us] at which all motors give a share of their largest thrust."""
        part = min(max((share - self.idle) / (1.0 - self.idle), 0.0), 1.0)
        return round(_LOW + part * (HIGH - _LOW))

    def motors_of(self, drone: DroneConfig) -> list[int]:
        """Return which of its motors each rotor of a drone is; raises ValueError."""
        motors = _mixer(drone)[1]
        return [motors.index(rotor) for rotor in range(drone.n)]

    @property
    def attitude_gain(self) -> float:
        """Angular velocity per error of the attitude [1/s]."""
        return 0.1 * self.angle_gain

    def rate_gain(self, drone: DroneConfig) -> float:
        """Return the moment per error of the angular velocity [Nm s/rad], of roll and pitch."""
        name, order = _mixer(drone)
        shares = np.array(_MIXERS[drone.n][1])[:, :2]
        places = np.array([drone.rotors[rotor].position for rotor in order])
        most = np.array([drone.rotors[rotor].thrust_max for rotor in order])
        levers = np.column_stack([places[:, 1], -places[:, 0]])
        moment = float(np.sum(most[:, np.newaxis] * levers * shares, axis=0).mean())
        per_sum = self.p * _P_SCALE * np.degrees(1.0) / _SUM_SCALE
        return float((1.0 - self.idle) * per_sum * moment)

    @property
    def integral_rate(self) -> float:
        """Of the integral, over the gain of the angular velocity [1/s]."""
        return self.i * _I_SCALE / (self.p * _P_SCALE)


def _mixer(drone: DroneConfig) -> tuple[str, list[int]]:
    """Return the mixer's name, and the rotor that each of its motors is."""
    if drone.is_fully_actuated or drone.n not in _MIXERS:
        raise ValueError(
            f"loops 'betaflight': {drone.name} is no quadrotor or hexarotor with rotors in one "
            'plane in the form of an X'
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
                f"loops 'betaflight': {drone.name} has no rotor where its mixer {name} has one, or "
                'it turns the other way'
            )
        order.append(rotor)
    return name, order
