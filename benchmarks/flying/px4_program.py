"""PX4 as a program on this host, configured for a drone."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from flying.firmware_program import FirmwareProgram

from aerarm_ros.autopilot.px4 import GPS, VISION, Px4Gains, hover_share
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


ROTORS = 12
"""Largest number of motors that PX4 controls."""

AIRFRAME = '10016'
"""Number of PX4's airframe none_iris, a multirotor whose simulator connects over TCP.
"""

_FRD = np.array([1.0, -1.0, -1.0])
_VISION_PARAMETERS = {
    'EKF2_EV_CTRL': 15, 'EKF2_HGT_REF': 3, 'EKF2_GPS_CTRL': 0, 'EKF2_BARO_CTRL': 0,
    'EKF2_MAG_TYPE': 5, 'EKF2_EV_NOISE_MD': 0, 'EKF2_EVP_NOISE': 0.01, 'EKF2_EVV_NOISE': 0.01,
    'EKF2_EVA_NOISE': 0.05, 'EKF2_EV_DELAY': 0.0, 'SYS_HAS_GPS': 0, 'SYS_HAS_MAG': 0,
}  # fmt: skip
_GPS_PARAMETERS = {
    'EKF2_EV_CTRL': 0, 'EKF2_HGT_REF': 1, 'EKF2_GPS_CTRL': 7, 'EKF2_MAG_TYPE': 0,
    'EKF2_GPS_DELAY': 0.0, 'EKF2_REQ_GPS_H': 2.0,
}  # fmt: skip
# No manual control, no ground station, a battery that does not drain; one IMU. The last parameter
# keeps PX4 armed while the drone is held.
_BENCH_PARAMETERS = {
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


@dataclass(frozen=True)
class Px4Setup:
    """Gains and position source from which `parameters` derives PX4's parameters.

    Attributes
    ----------
    sensors : str
        One of `px4.SENSORS`.
    others : dict
        Further parameters, by PX4's names, which override all others.
    """

    gains: Px4AllGains = Px4AllGains()
    sensors: str = VISION
    others: dict[str, float] = field(default_factory=dict)

    def parameters(self, drone: DroneConfig, body: MassProperties) -> dict[str, float]:
        """Return all PX4 parameters for a drone as a mapping from their names.

        Parameters
        ----------
        body : MassProperties
            Mass properties of drone and arm at rest, because PX4's lever arms begin at the centre
            of mass.

        Raises
        ------
        ValueError
            If PX4 has too few motors, or the drone cannot hover on 10 to 80 % of its thrust.
        """
        if drone.n > ROTORS:
            raise ValueError(
                f'{drone.name} has {drone.n} rotors, but PX4 controls {ROTORS} at most: use '
                'a drone file with fewer rotors'
            )
        return {
            **_BENCH_PARAMETERS,
            **(_GPS_PARAMETERS if self.sensors == GPS else _VISION_PARAMETERS),
            **_geometry(drone, body),
            'MPC_THR_HOVER': hover_share(drone, body),
            **_gains(self.gains),
            **self.others,
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
