"""Displacement of a drone with coplanar rotors that is caused by its tilt."""

from pathlib import Path

import numpy as np
from flying.flight_program import FlightProgram

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, MassProperties
from aerarm_ros.motion.signals import JointReference

_STEP = 0.02  # [s]


def tilt_limit(
    drone: DroneConfig, program: FlightProgram, urdf: Path | None = None
) -> dict[str, float]:
    """Return, for each part, the RMS body displacement [mm] at constant centre of mass.

    Against a lateral force f such a drone tilts by f / (m g), and its body, at a height h above the
    common centre of mass, moves by h f / (m g). A drone with lateral thrust needs no tilt.

    Parameters
    ----------
    urdf : Path, optional
        URDF of the arm, by default the nominal one.
    """
    if drone.is_fully_actuated:
        return {}
    loads = ArmLoadModel(load_robot(urdf, gravity_in_base=drone.gravity_in_base))

    def off(motion: JointReference) -> float:
        load = loads.evaluate(motion)
        body = MassProperties.of(drone, load.mass, load.com, load.inertia)
        sideways = (drone.mount.rotation @ load.motion[:3])[:2]
        return float(body.centre[2] * np.linalg.norm(sideways) / (body.mass * GRAVITY))

    found = {}
    for part, (begin, end) in program.windows.items():
        if begin >= 0.0:
            rows = zip(*program.motion.evaluate(np.arange(begin, end, _STEP)), strict=True)
            values = np.array([off(JointReference(*row)) for row in rows])
            found[part] = 1e3 * float(np.sqrt((values**2).mean()))
    return found
