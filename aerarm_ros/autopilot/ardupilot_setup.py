"""ArduCopter's frames and gains for a drone."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.autopilot.ardupilot_loop import ArduPilotLoop
from aerarm_ros.autopilot.px4 import VISION
from aerarm_ros.description.drone_config import DroneConfig

# Angle [deg] of each motor from the front, clockwise, and whether its propeller turns clockwise
# (`AP_MotorsMatrix.cpp`, frame type X); by number of rotors, with the frame's class.
FRAMES: dict[int, tuple[int, list[tuple[float, bool]]]] = {
    4: (1, [(45, False), (-135, False), (-45, True), (135, True)]),
    6: (2, [(90, True), (-90, False), (-30, True), (150, False), (30, False), (-150, True)]),
}
_NEAR = 10.0  # [deg] largest deviation of a rotor from its place in the frame


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
        One of `px4.SENSORS`.
    """

    att_p: float = 6.5
    rate_p: float = 0.4
    rate_i: float = 0.4
    rate_d: float = 0.006
    loop: ArduPilotLoop = ArduPilotLoop()
    sensors: str = VISION

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
    angles = np.radians([angle for angle, _ in FRAMES[drone.n][1]])
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
    frame = FRAMES.get(drone.n, (0, []))[1]
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
