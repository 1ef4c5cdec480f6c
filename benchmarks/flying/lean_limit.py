"""How far a drone with rotors in one plane moves because it has to lean."""

from pathlib import Path

import numpy as np
from flying.flight_program import FlightProgram

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, MassProperties
from aerarm_ros.motion.signals import JointReference

_STEP = 0.02  # [s]


def lean_limit(
    drone: DroneConfig, program: FlightProgram, urdf: Path | None = None
) -> dict[str, float]:
    """Return for each part the RMS [mm] by which the body moves if the centre of mass does not.

    Against a force f from the side such a drone leans by f / (m g), and its body, h above the
    common centre of mass, moves by h f / (m g). A drone that pushes sideways needs no lean.

    Parameters
    ----------
    drone : DroneConfig
    program : FlightProgram
    urdf : Path, optional
        Of the arm, the drawn one if not given.
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
