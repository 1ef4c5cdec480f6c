"""ArduCopter as a program on this host, configured for a drone."""

import os
from pathlib import Path

from flying.firmware_program import FirmwareProgram

from aerarm_ros.autopilot.ardupilot_link import COMPANION_PORT, PORT_STEP
from aerarm_ros.autopilot.ardupilot_setup import FRAMES, ArduPilotSetup, motors_of
from aerarm_ros.autopilot.px4 import GPS, hover_share
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


def parameters_of(
    setup: ArduPilotSetup, drone: DroneConfig, body: MassProperties
) -> dict[str, float]:
    """Return all ArduCopter parameters for a drone as a mapping from their names.

    Raises
    ------
    ValueError
        If ArduCopter has no frame for the drone, or the drone cannot hover on 10 to 80 % of
        its thrust.
    """
    motors_of(drone)
    gains = {f'ATC_ANG_{axis}_P': setup.att_p for axis in ('RLL', 'PIT')}
    for axis in ('RLL', 'PIT'):
        for term in 'pid':
            gains[f'ATC_RAT_{axis}_{term.upper()}'] = getattr(setup, f'rate_{term}')
        gains[f'ATC_RAT_{axis}_FLTD'] = gains[f'ATC_RAT_{axis}_FLTT'] = 40.0
    return {
        **_BENCH_PARAMETERS,
        **({} if setup.sensors == GPS else _VISION_PARAMETERS),
        'FRAME_CLASS': FRAMES[drone.n][0],
        'FRAME_TYPE': 1,  # X
        'MOT_THST_HOVER': hover_share(drone, body),
        # The commanded tilt goes to the attitude loop without shaping.
        'ATC_RATE_FF_ENAB': 0,
        **gains,
        'PSC_POSXY_P': setup.loop.position_p,
        'PSC_VELXY_P': setup.loop.velocity_p,
        'PSC_VELXY_I': setup.loop.velocity_i,
        'PSC_VELXY_D': 0.0,
        'PSC_VELXY_FLTE': 0.0,
        'PSC_JERK_XY': 20.0,
    }


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
        self._parameters = parameters_of(setup, drone, body)

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
