"""The firmware of an autopilot as a program on this host, configured for a drone."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from aerarm_ros.autopilot.ardupilot import FRAMES, ArduPilotSetup, motors_of
from aerarm_ros.autopilot.ardupilot_flight import COMPANION_PORT, PORT_STEP
from aerarm_ros.autopilot.px4 import GPS, VISION, Px4Gains, hover_share
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties

HOW = {
    'px4': (
        "PX4 is missing: build it (make px4_sitl_default), then run 'make flight AUTOPILOT=px4 "
        "PX4=<folder of the build>'. The folder contains bin/px4 and etc"
    ),
    'ardupilot': (
        'ArduPilot is missing: build it (./waf configure --board sitl && ./waf copter), then run '
        "'make flight AUTOPILOT=ardupilot ARDUPILOT=<folder of ArduPilot>'. The folder contains "
        'build/sitl/bin/arducopter'
    ),
}
_ENDING = 5.0  # [s]
# Ends the program together with the process that starts it, because PX4 runs on without its
# simulator. The guard is a separate process, since code between fork and exec may hang with
# threads.
_GUARD = """
import ctypes, os, signal, sys
parent = int(sys.argv[1])
ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)
if os.getppid() == parent:
    os.execv(sys.argv[2], sys.argv[2:])
"""


class FirmwareProgram:
    """Context manager that runs a program, and ends it also after `kill -9` of this process.

    Parameters
    ----------
    folder : Path
        Working folder of the program.
    log : str
        Name of the log file in this folder.

    Attributes
    ----------
    log : Path
        Log file of the program's output.
    """

    def __init__(self, folder: Path, log: str) -> None:
        self.folder, self.log = folder, folder / log
        self._process: subprocess.Popen[bytes] | None = None

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Return command line and environment."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self.start()
        return self

    def start(self) -> None:
        """Start the program."""
        command, environment = self.command()
        guard = [sys.executable, '-c', _GUARD, str(os.getpid())]
        with self.log.open('ab') as log:
            self._process = subprocess.Popen(
                [*guard, *command], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=log,
                stderr=log, env=environment, start_new_session=True,
            )  # fmt: skip

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def is_running(self) -> bool:
        """Whether the program has been started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def end(self) -> None:
        """End the program if it runs."""
        if self._process is None or not self.is_running:
            return
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def pid(self) -> int:
        """Process id of the program."""
        assert self._process is not None
        return self._process.pid


_PX4_PROGRAM = 'bin/px4'


def find_px4() -> Path | None:
    """Return the folder of the build in the variable PX4, None if not set."""
    given = os.environ.get('PX4', '')
    places = [Path(given).expanduser() / part for part in ('', 'build/px4_sitl_default')]
    return next((place for place in places if given and (place / _PX4_PROGRAM).is_file()), None)


_ROTORS = 12  # largest number of motors that PX4 controls
_AIRFRAME = '10016'  # none_iris, a multirotor whose simulator connects over TCP
_FRD = np.array([1.0, -1.0, -1.0])
_PX4_VISION = {
    'EKF2_EV_CTRL': 15, 'EKF2_HGT_REF': 3, 'EKF2_GPS_CTRL': 0, 'EKF2_BARO_CTRL': 0,
    'EKF2_MAG_TYPE': 5, 'EKF2_EV_NOISE_MD': 0, 'EKF2_EVP_NOISE': 0.01, 'EKF2_EVV_NOISE': 0.01,
    'EKF2_EVA_NOISE': 0.05, 'EKF2_EV_DELAY': 0.0, 'SYS_HAS_GPS': 0, 'SYS_HAS_MAG': 0,
}  # fmt: skip
_PX4_GPS = {
    'EKF2_EV_CTRL': 0, 'EKF2_HGT_REF': 1, 'EKF2_GPS_CTRL': 7, 'EKF2_MAG_TYPE': 0,
    'EKF2_GPS_DELAY': 0.0, 'EKF2_REQ_GPS_H': 2.0,
}  # fmt: skip
# No manual control, no ground station, a battery that does not drain; one IMU. The last parameter
# keeps PX4 armed while the drone is held.
_PX4_BENCH = {
    'COM_RC_IN_MODE': 4, 'COM_RCL_EXCEPT': 4, 'NAV_DLL_ACT': 0, 'CBRK_SUPPLY_CHK': 894281,
    'SIM_BAT_DRAIN': 86400.0, 'SENS_IMU_MODE': 1, 'EKF2_MULTI_IMU': 0, 'IMU_GYRO_RATEMAX': 250,
    'MC_AT_EN': 0, 'SDLOG_MODE': 0, 'SDLOG_PROFILE': 1, 'COM_OBL_RC_ACT': 5,
    'COM_DISARM_PRFLT': -1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Px4AllGains(Px4Gains):
    """Gains of PX4's multicopter loops, by PX4's parameter names, with PX4's defaults of 2026.

    Attributes
    ----------
    mpc_xy_p, mpc_z_p : float
        Velocity per position error [1/s].
    mpc_xy_vel_p_acc, mpc_z_vel_p_acc : float
        Acceleration per velocity error [1/s].
    mpc_xy_vel_i_acc, mpc_z_vel_i_acc : float
        Acceleration per integral of the velocity error [1/s^2].
    mpc_xy_vel_d_acc, mpc_z_vel_d_acc : float
        Acceleration per derivative of the velocity error [-].
    mc_rate_d : float
        Normalized torque per angular acceleration.
    mc_yawrate_i : float
        Normalized torque per integral of the angular velocity error about the vertical.
    mc_yaw_tq_cutoff : float
        MC_YAW_TQ_CUTOFF, the cut-off frequency of the yaw torque's low-pass filter [Hz].
    tilt_max : float
        MPC_TILTMAX_AIR, the largest commanded tilt [rad].
    thrust_min : float
        MPC_THR_MIN, the least commanded thrust as a fraction of the largest.
    """

    mpc_xy_p: float = 0.95
    mpc_z_p: float = 1.0
    mpc_xy_vel_p_acc: float = 1.8
    mpc_z_vel_p_acc: float = 4.0
    mpc_xy_vel_i_acc: float = 0.4
    mpc_z_vel_i_acc: float = 2.0
    mpc_xy_vel_d_acc: float = 0.2
    mpc_z_vel_d_acc: float = 0.0
    mc_rate_d: float = 0.003
    mc_yawrate_i: float = 0.1
    mc_yaw_tq_cutoff: float = 2.0
    tilt_max: float = 0.785
    thrust_min: float = 0.12

    @classmethod
    def scaled(
        cls,
        mpc_xy_p: float,
        mc_att_p: float,
        mc_rate_k: float,
        mc_yawrate_p: float = 0.2,
        mc_yaw_tq_cutoff: float = 2.0,
    ) -> 'Px4AllGains':
        """Return gains with the velocity loop scaled in proportion to the position gain.

        The gains `mpc_xy_vel_p_acc` and `mpc_xy_vel_i_acc` are scaled like `mpc_xy_p`, and
        `mc_yawrate_i` by the ratio of `mc_yawrate_p` to its default.
        """
        share = mpc_xy_p / cls.mpc_xy_p
        return cls(
            mpc_xy_p=mpc_xy_p,
            mpc_xy_vel_p_acc=share * cls.mpc_xy_vel_p_acc,
            mpc_xy_vel_i_acc=share * cls.mpc_xy_vel_i_acc,
            mc_att_p=mc_att_p,
            mc_rate_k=mc_rate_k,
            mc_yawrate_p=mc_yawrate_p,
            mc_yawrate_i=cls.mc_yawrate_i / cls.mc_yawrate_p * mc_yawrate_p,
            mc_yaw_tq_cutoff=mc_yaw_tq_cutoff,
        )


def px4_parameters(
    gains: Px4AllGains, drone: DroneConfig, body: MassProperties, sensors: str = VISION
) -> dict[str, float]:
    """Return all PX4 parameters for a drone as a mapping from their names.

    Parameters
    ----------
    body : MassProperties
        Mass properties of drone and arm at rest, because PX4's lever arms begin at the centre of
        mass.
    sensors : str
        One of `px4.SENSORS`.

    Raises
    ------
    ValueError
        If PX4 has too few motors, or the drone cannot hover on 10 to 80 % of its thrust.
    """
    if drone.n > _ROTORS:
        raise ValueError(
            f'{drone.name} has {drone.n} rotors, but PX4 controls {_ROTORS} at most: use a drone '
            'file with fewer rotors'
        )
    return {
        **_PX4_BENCH,
        **(_PX4_GPS if sensors == GPS else _PX4_VISION),
        **_geometry(drone, body),
        'MPC_THR_HOVER': hover_share(drone, body),
        **_gains(gains),
    }


def _geometry(drone: DroneConfig, body: MassProperties) -> dict[str, float]:
    """Return PX4's parameters that describe the poses of rotors (CA_*) and IMU."""
    found: dict[str, float] = {'CA_AIRFRAME': 0, 'CA_ROTOR_COUNT': drone.n}
    for i, rotor in enumerate(drone.rotors):
        place = _FRD * (np.array(rotor.position) - body.centre)
        axis = _FRD * np.array(rotor.axis) / np.linalg.norm(rotor.axis)
        names = [f'CA_ROTOR{i}_{key}' for key in ('PX', 'PY', 'PZ', 'AX', 'AY', 'AZ')]
        found.update(zip(names, np.concatenate([place, axis]).tolist(), strict=True))
        found[f'CA_ROTOR{i}_CT'] = rotor.thrust_max
        found[f'CA_ROTOR{i}_KM'] = -rotor.moment_per_thrust
        found[f'PWM_MAIN_FUNC{i + 1}'] = 101 + i
    imu = _FRD * np.array(drone.imu.position)
    names = [f'EKF2_IMU_POS_{axis}' for axis in 'XYZ']
    found.update(zip(names, imu.tolist(), strict=True))
    return found


def _gains(gains: Px4AllGains) -> dict[str, float]:
    found = {'MPC_THR_MIN': gains.thrust_min, 'MPC_TILTMAX_AIR': float(np.degrees(gains.tilt_max))}
    for name, value in vars(gains).items():
        if name.startswith(('mpc_', 'mc_yaw')):
            found[name.upper()] = value
        elif name.startswith('mc_'):
            for axis in ('roll', 'pitch'):
                one = name.replace('att', axis).replace('rate', f'{axis}rate')
                found[one.upper()] = value
    return found


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
    gains : Px4AllGains
        Gains of PX4.
    instance : int
        Instance number, which determines the ports.
    sensors : str
        One of `px4.SENSORS`.

    Raises
    ------
    ValueError
        If PX4 cannot fly the drone.
    """

    def __init__(
        self, build: Path, folder: Path, drone: DroneConfig, body: MassProperties,
        gains: Px4AllGains, instance: int = 0, sensors: str = VISION,
    ) -> None:  # fmt: skip
        super().__init__(folder, 'px4.log')
        self._build, self._instance = build.resolve(), instance
        self._parameters = px4_parameters(gains, drone, body, sensors)

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Return command line and environment."""
        program = str(self._build / _PX4_PROGRAM)
        command = [program, '-d', '-i', str(self._instance), str(self._build / 'etc')]
        command += ['-w', str(self.folder)]
        environment = {
            **os.environ,
            'PATH': f'{self._build / "bin"}:{os.environ["PATH"]}',
            'PX4_SYS_AUTOSTART': _AIRFRAME,
            'PX4_SIM_HOST_ADDR': '127.0.0.1',
            **{f'PX4_PARAM_{name}': f'{value:.7g}' for name, value in self._parameters.items()},
        }
        environment.pop('PX4_SIM_MODEL', None)
        return command, environment


_ARDUPILOT_PROGRAM = 'build/sitl/bin/arducopter'


def find_ardupilot() -> Path | None:
    """Return the program in the folder of the variable ARDUPILOT, None if not set."""
    given = os.environ.get('ARDUPILOT', '')
    program = Path(given).expanduser() / _ARDUPILOT_PROGRAM
    return program if given and program.is_file() else None


_ARDUPILOT_VISION = {
    'VISO_TYPE': 1, 'VISO_DELAY_MS': 4, 'VISO_POS_M_NSE': 0.01, 'VISO_VEL_M_NSE': 0.05,
    'VISO_YAW_M_NSE': 0.05, 'EK3_SRC1_POSXY': 6, 'EK3_SRC1_VELXY': 6, 'EK3_SRC1_POSZ': 6,
    'EK3_SRC1_VELZ': 6, 'EK3_SRC1_YAW': 6, 'GPS1_TYPE': 0, 'COMPASS_ENABLE': 0,
}  # fmt: skip
# No manual control, no failsafe of a ground station, no checks of sensors that this simulator does
# not have, and linear motors whose command is their fraction of the largest thrust.
_ARDUPILOT_BENCH = {
    'ARMING_SKIPCHK': -1, 'FS_THR_ENABLE': 0, 'FS_GCS_ENABLE': 0, 'FS_CRASH_CHECK': 0,
    'DISARM_DELAY': 0, 'LOG_BACKEND_TYPE': 0, 'MOT_THST_EXPO': 0, 'MOT_SPIN_ARM': 0,
    'MOT_SPIN_MIN': 0, 'MOT_SPIN_MAX': 1, 'MOT_PWM_MIN': 1000, 'MOT_PWM_MAX': 2000,
    'MOT_HOVER_LEARN': 0, 'MOT_BAT_VOLT_MAX': 0, 'INS_GYRO_FILTER': 80, 'INS_ACCEL_FILTER': 30,
    'INS_ACC2OFFS_X': 0, 'INS_ACC2OFFS_Y': 0, 'INS_ACC2OFFS_Z': 0, 'EK3_IMU_MASK': 1,
    'SIM_BATT_VOLTAGE': 16, 'BATT_MONITOR': 0, 'SCHED_LOOP_RATE': 400,
}  # fmt: skip


def ardupilot_parameters(
    drone: DroneConfig, body: MassProperties, sensors: str = VISION
) -> dict[str, float]:
    """Return all ArduCopter parameters for a drone as a mapping from their names.

    Raises
    ------
    ValueError
        If ArduCopter has no frame for the drone, or the drone cannot hover on 10 to 80 % of
        its thrust.
    """
    motors_of(drone)
    setup = ArduPilotSetup()
    gains = {f'ATC_ANG_{axis}_P': setup.att_p for axis in ('RLL', 'PIT')}
    for axis in ('RLL', 'PIT'):
        for term in 'pid':
            gains[f'ATC_RAT_{axis}_{term.upper()}'] = getattr(setup, f'rate_{term}')
        gains[f'ATC_RAT_{axis}_FLTD'] = gains[f'ATC_RAT_{axis}_FLTT'] = 40.0
    return {
        **_ARDUPILOT_BENCH,
        **({} if sensors == GPS else _ARDUPILOT_VISION),
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
    instance : int
        Instance number, which determines the ports.
    port : int
        UDP port to which ArduCopter opens a second MAVLink connection; 0 for none.
    sensors : str
        One of `px4.SENSORS`.

    Raises
    ------
    ValueError
        If ArduPilot cannot fly the drone.
    """

    def __init__(
        self, program: Path, folder: Path, drone: DroneConfig, body: MassProperties,
        instance: int = 0, port: int = 0, sensors: str = VISION,
    ) -> None:  # fmt: skip
        super().__init__(folder, 'ardupilot.log')
        self._program, self._instance, self._port = program.resolve(), instance, port
        self._parameters = ardupilot_parameters(drone, body, sensors)

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
