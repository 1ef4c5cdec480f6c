"""PX4 as a program on this host, configured for a drone."""

import os
from pathlib import Path

from flying.firmware_program import FirmwareProgram

from aerarm_ros.autopilot.px4_setup import AIRFRAME, Px4Setup
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties

HOW = (
    "PX4 is missing: build it (make px4_sitl_default), then run 'make flight AUTOPILOT=px4 "
    "PX4=<folder of the build>'. The folder contains bin/px4 and etc"
)
_PROGRAM = 'bin/px4'


def find_px4() -> Path | None:
    """Return the folder of the build in the variable PX4, None if not set."""
    given = os.environ.get('PX4', '')
    places = [Path(given).expanduser() / part for part in ('', 'build/px4_sitl_default')]
    return next((place for place in places if given and (place / _PROGRAM).is_file()), None)


class Px4Program(FirmwareProgram):
    """Context manager that runs PX4 in a separate folder, configured for a drone.

    Parameters
    ----------
    build : Path
        Folder of the PX4 build.
    folder : Path
        Folder of parameters and logs.
    drone : DroneConfig
        Configuration of the drone.
    body : MassProperties
        Mass properties of drone and arm at rest.
    setup : Px4Setup
        Settings of PX4.
    instance : int
        Instance number, which determines the ports.

    Attributes
    ----------
    log : Path
        Log file of its output.

    Raises
    ------
    ValueError
        If PX4 cannot fly the drone.
    """

    def __init__(
        self, build: Path, folder: Path, drone: DroneConfig, body: MassProperties,
        setup: Px4Setup, instance: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(folder, 'px4.log')
        self._build, self._instance = build.resolve(), instance
        self._parameters = setup.parameters(drone, body)

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Return command line and environment."""
        program = str(self._build / _PROGRAM)
        command = [program, '-d', '-i', str(self._instance), str(self._build / 'etc')]
        command += ['-w', str(self.folder)]
        environment = {
            **os.environ,
            'PATH': f'{self._build / "bin"}:{os.environ["PATH"]}',
            'PX4_SYS_AUTOSTART': AIRFRAME,
            'PX4_SIM_HOST_ADDR': '127.0.0.1',
            **{f'PX4_PARAM_{name}': f'{value:.7g}' for name, value in self._parameters.items()},
        }
        environment.pop('PX4_SIM_MODEL', None)
        return command, environment
