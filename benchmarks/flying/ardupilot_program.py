"""ArduCopter as a program on this host, configured for a drone."""

import os
from pathlib import Path

from flying.firmware_program import FirmwareProgram

from aerarm_ros.autopilot.ardupilot_link import COMPANION_PORT, PORT_STEP
from aerarm_ros.autopilot.ardupilot_setup import ArduPilotSetup
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties

HOW = (
    "ArduPilot is missing: build it (./waf configure --board sitl && ./waf copter), then run 'make "
    "flight AUTOPILOT=ardupilot ARDUPILOT=<folder of ArduPilot>'. The folder contains "
    'build/sitl/bin/arducopter'
)
_PROGRAM = 'build/sitl/bin/arducopter'


def find_ardupilot() -> Path | None:
    """Return the program in the folder of the variable ARDUPILOT, None if not set."""
    given = os.environ.get('ARDUPILOT', '')
    program = Path(given).expanduser() / _PROGRAM
    return program if given and program.is_file() else None


class ArduPilotProgram(FirmwareProgram):
    """Context manager that runs ArduCopter in a separate folder, configured for a drone.

    Parameters
    ----------
    program : Path
        Program of ArduCopter.
    folder : Path
        Folder of parameters and logs.
    drone : DroneConfig
        Configuration of the drone.
    body : MassProperties
        Mass properties of drone and arm at rest.
    setup : ArduPilotSetup
        Settings of ArduPilot.
    instance : int
        Instance number, which determines the ports.
    port : int
        UDP port to which ArduCopter opens a second MAVLink connection; 0 for none.

    Attributes
    ----------
    log : Path
        Log file of its output.

    Raises
    ------
    ValueError
        If ArduPilot cannot fly the drone.
    """

    def __init__(
        self, program: Path, folder: Path, drone: DroneConfig, body: MassProperties,
        setup: ArduPilotSetup, instance: int = 0, port: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(folder, 'ardupilot.log')
        self._program, self._instance, self._port = program.resolve(), instance, port
        self._parameters = setup.parameters(drone, body)

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Write the parameters; return command line and environment."""
        defaults = self.folder / 'drone.parm'
        lines = [f'{name} {value:.7g}\n' for name, value in self._parameters.items()]
        defaults.write_text(''.join(lines))
        port = COMPANION_PORT + PORT_STEP * self._instance
        command = [str(self._program), '--model', 'JSON:127.0.0.1', '-I', str(self._instance)]
        command += ['--wipe', '--defaults', str(defaults), '--speedup', '100']
        command += ['--serial0', f'udpclient:127.0.0.1:{port}']
        if self._port:
            command += ['--serial1', f'udpclient:127.0.0.1:{self._port}']
        return command, dict(os.environ)
