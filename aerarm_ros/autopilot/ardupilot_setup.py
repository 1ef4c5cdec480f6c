"""ArduCopter's parameters for a drone: frame, hover thrust, gains and position source."""

from dataclasses import dataclass, field

import numpy as np

from aerarm_ros.autopilot.ardupilot_loop import ArduPilotLoop
from aerarm_ros.autopilot.px4_setup import GPS, VISION, hover_share
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties

# Angle [deg] of each motor from the front, clockwise, and whether its propeller turns clockwise
# (`AP_MotorsMatrix.cpp`, frame type X); by number of rotors, with the frame's class.
_FRAMES: dict[int, tuple[int, list[tuple[float, bool]]]] = {
    4: (1, [(45, False), (-135, False), (-45, True), (135, True)]),
    6: (2, [(90, True), (-90, False), (-30, True), (150, False), (30, False), (-150, True)]),
}
_FRAME_X = 1
_NEAR = 10.0  # [deg] largest deviation of a rotor from its place in the frame
_VISION_PARAMETERS = {
    'VISO_TYPE': 1, 'VISO_DELAY_MS': 4, 'VISO_POS_M_NSE': 0.01, 'VISO_VEL_M_NSE': 0.05,
    'VISO_YAW_M_NSE': 0.05, 'EK3_SRC1_POSXY': 6, 'EK3_SRC1_VELXY': 6, 'EK3_SRC1_POSZ': 6,
    'EK3_SRC1_VELZ': 6, 'EK3_SRC1_YAW': 6, 'GPS1_TYPE': 0, 'COMPASS_ENABLE': 0,
}  # fmt: skip
# No manual control, no failsafe of a ground station, no checks of sensors that this simulator does
# not have, and linear motors whose command is their fraction of the largest thrust.
_BENCH_PARAMETERS = {
    'ARMING_SKIPCHK': -1, 'FS_THR_ENABLE': 0, 'FS_GCS_ENABLE': 0, 'FS_CRASH_CHECK': 0,
    'DISARM_DELAY': 0, 'LOG_BACKEND_TYPE': 0, 'MOT_THST_EXPO': 0, 'MOT_SPIN_ARM': 0,
    'MOT_SPIN_MIN': 0, 'MOT_SPIN_MAX': 1, 'MOT_PWM_MIN': 1000, 'MOT_PWM_MAX': 2000,
    'MOT_HOVER_LEARN': 0, 'MOT_BAT_VOLT_MAX': 0, 'INS_GYRO_FILTER': 80, 'INS_ACCEL_FILTER': 30,
    'INS_ACC2OFFS_X': 0, 'INS_ACC2OFFS_Y': 0, 'INS_ACC2OFFS_Z': 0, 'EK3_IMU_MASK': 1,
    'SIM_BATT_VOLTAGE': 16, 'BATT_MONITOR': 0, 'SCHED_LOOP_RATE': 400,
}  # fmt: skip


@dataclass(frozen=True)
class ArduPilotSetup:
    """Gains and position source of ArduCopter.

    Attributes
    ----------
    att_p : float
        ATC_ANG_RLL_P and ATC_ANG_PIT_P, angular velocity per attitude error [1/s].
    rate_p, rate_i, rate_d : float
        ATC_RAT_RLL_P and so on: fraction of the largest roll moment per error of the angular
        velocity [s/rad], its integral and its derivative.
    loop : ArduPilotLoop
        Gains of the position loop.
    sensors : str
        One of `px4_setup.SENSORS`.
    others : dict
        Further parameters, by ArduPilot's names, which override all others.
    """

    att_p: float = 6.5
    rate_p: float = 0.4
    rate_i: float = 0.4
    rate_d: float = 0.006
    loop: ArduPilotLoop = ArduPilotLoop()
    sensors: str = VISION
    others: dict[str, float] = field(default_factory=dict)

    def parameters(self, drone: DroneConfig, body: MassProperties) -> dict[str, float]:
        """Return all ArduCopter parameters for a drone as a mapping from their names.

        Raises
        ------
        ValueError
            If ArduCopter has no frame for the drone, or the drone cannot hover on 10 to 80 % of
            its thrust.
        """
        motors_of(drone)
        hover = hover_share(drone, body)
        gains = {f'ATC_ANG_{axis}_P': self.att_p for axis in ('RLL', 'PIT')}
        for axis in ('RLL', 'PIT'):
            for term in 'pid':
                gains[f'ATC_RAT_{axis}_{term.upper()}'] = getattr(self, f'rate_{term}')
            gains[f'ATC_RAT_{axis}_FLTD'] = gains[f'ATC_RAT_{axis}_FLTT'] = 40.0
        return {
            **_BENCH_PARAMETERS,
            **({} if self.sensors == GPS else _VISION_PARAMETERS),
            'FRAME_CLASS': _FRAMES[drone.n][0],
            'FRAME_TYPE': _FRAME_X,
            'MOT_THST_HOVER': hover,
            # The commanded tilt goes to the attitude loop without shaping.
            'ATC_RATE_FF_ENAB': 0,
            **gains,
            **self.loop.parameters(),
            **self.others,
        }

    def rate_gain(self, drone: DroneConfig) -> float:
        """Return the roll or pitch loop's moment per angular velocity error [Nm s/rad]."""
        return self.rate_p * moment_unit(drone)


def moment_unit(drone: DroneConfig) -> float:
    """Return the mean roll and pitch moment [Nm] for ArduCopter's normalized command 1.

    Raises
    ------
    ValueError
        If ArduCopter's frame of type X does not have the drone's rotors.
    """
    rotors = [drone.rotors[index] for index in motors_of(drone)]
    angles = np.radians([angle for angle, _ in _FRAMES[drone.n][1]])
    shares = np.abs(np.array([np.sin(angles), np.cos(angles)]))  # of roll and pitch
    shares = 0.5 * shares / shares.max(axis=1, keepdims=True)
    levers = np.abs(np.array([rotor.position[:2] for rotor in rotors]).T[::-1])
    return float(((shares * levers) @ [rotor.thrust_max for rotor in rotors]).mean())


def motors_of(drone: DroneConfig) -> list[int]:
    """Return, for each of ArduPilot's motors in order, the number of the drone's rotor.

    Raises
    ------
    ValueError
        If ArduCopter's frame of type X does not have the drone's rotors.
    """
    frame = _FRAMES.get(drone.n, (0, []))[1]
    found = []
    for angle, turns_clockwise in frame:
        for index, rotor in enumerate(drone.rotors):
            x, y = rotor.position[:2]
            off = (np.degrees(np.arctan2(-y, x)) - angle + 180.0) % 360.0 - 180.0
            is_level = rotor.axis[2] > 0.999
            if abs(off) < _NEAR and is_level and (rotor.moment_per_thrust > 0) == turns_clockwise:
                found.append(index)
    if not frame or len(found) != drone.n:
        raise ValueError(
            f'ArduPilot has no frame for {drone.name}: ArduPilot flies 4 or 6 level rotors in X '
            "form, each with the direction of ArduPilot's motor order; check position, axis and "
            'moment_per_thrust in the drone file'
        )
    return found
