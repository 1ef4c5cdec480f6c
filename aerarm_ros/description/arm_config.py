"""Drive train configuration of a whole arm, read from YAML."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import (
    ConfigError,
    build,
    check_fields,
    check_keys,
    check_range,
    check_unique,
    load,
    one_of,
    ranged,
    section,
    vector,
)
from aerarm_ros.description.drive_config import GearConfig, JointConfig, MotorConfig, ThermalConfig
from aerarm_ros.motion.signals import Array

ENCODERS = ('incremental', 'absolute')


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """Board that controls two motors, and its connection to the SPI bus.

    Attributes
    ----------
    device : str
        Device file, for example '/dev/spidev0.0' (bus 0, chip select 0).
    clock_hz : int
        SPI clock [Hz].
    mode : int
        SPI mode 0-3 (clock polarity and phase).
    encoders : str
        'incremental' if the encoders count from power-on, 'absolute' if they know their angle at
        power-on; '' for the type given by the frame profile.

    Raises
    ------
    ConfigError
        If a value is outside its range.
    """

    name: str
    device: str
    clock_hz: int = ranged(100_000, 50_000_000, 'Hz')
    mode: int = one_of(0, 1, 2, 3)
    encoders: str = one_of('', *ENCODERS, default='')

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields(f'board {self.name}', self)


@dataclass(frozen=True, slots=True)
class PowerStageConfig:
    """Power consumption of the boards, and the boards' use of braking energy.

    Attributes
    ----------
    recovery : float
        Fraction of a braking motor's electrical power that the supply absorbs, 0 to 1; the rest is
        dissipated.
    standby : float
        Power of all boards without motor current [W].
    voltage_min, voltage_max : float
        Supply voltages [V] beyond which the arm is stopped, if the boards report them.

    Raises
    ------
    ConfigError
        If a value is outside its range.
    """

    recovery: float = ranged(0.0, 1.0, default=0.0)
    standby: float = ranged(0.0, 1e3, 'W', default=0.0)
    voltage_min: float = ranged(0.0, 1e3, 'V', default=0.0)
    voltage_max: float = ranged(0.0, 1e3, 'V', default=1e3)

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields('power_stage', self)
        if self.voltage_min >= self.voltage_max:
            raise ConfigError(
                f'power_stage: voltage_min = {self.voltage_min} must be below voltage_max = '
                f'{self.voltage_max}'
            )


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """Drive train configuration of an arm; the URDF is separate.

    Attributes
    ----------
    joints : tuple of JointConfig
        The n joints from base to tool.
    boards : tuple of BoardConfig
        Boards, indexed from 0 by `JointConfig.board`.
    profile : str
        Name of the boards' frame profile, for example 'uomodri_v3'.
    gravity_in_base : tuple of 3 floats
        Gravity in the base frame [m/s^2].
    rest_position : tuple of n floats
        Home configuration [rad].
    coupled_joints : tuple of (joint, driver)
        Pairs of joint names: the motion of the driver causes torque at the joint (used by the
        identification).
    rated_payload : tuple of 4 floats
        Largest payload for which the bridge's limits are valid: mass [kg], and x, y, z of its
        centre of mass in the frame of the last link's joint [m].
    power_stage : PowerStageConfig
        Power consumption of the boards, and their use of braking energy.
    emulated_only : bool
        Whether some values are guessed, so that the configuration must not drive real motors.

    Raises
    ------
    ConfigError
        If parts contradict each other, for example two joints on one channel of a board.
    """

    name: str
    joints: tuple[JointConfig, ...]
    boards: tuple[BoardConfig, ...]
    profile: str
    rest_position: tuple[float, ...]
    gravity_in_base: tuple[float, ...] = vector(20.0, 'm/s^2')
    coupled_joints: tuple[tuple[str, str], ...] = ()
    rated_payload: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    power_stage: PowerStageConfig = PowerStageConfig()
    emulated_only: bool = False

    def __post_init__(self) -> None:
        """Check conditions that concern several parts of the configuration."""
        check_fields('arm', self)
        if not self.joints:
            raise ConfigError('arm: joints is empty; list at least one joint')
        check_unique('joints', 'name', self.joint_names)
        check_unique('boards', 'name', [board.name for board in self.boards])
        check_unique('boards', 'device', [board.device for board in self.boards])
        self._check_channels()
        self._check_rest_position()
        self._check_coupled_joints()
        self._check_rated_payload()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, from base to tool."""
        return tuple(joint.name for joint in self.joints)

    def column(self, field: str) -> npt.NDArray[np.float64]:
        """Return the values of one numeric attribute of `JointConfig` for all joints.

        Parameters
        ----------
        field : str
            Attribute of `JointConfig` or of its parts: 'effort_max', 'reflected_inertia',
            'motor.current_max', 'gear.ratio'.

        Returns
        -------
        (n,) ndarray
            Values in the attribute's unit, in the order of `joint_names`.

        Raises
        ------
        AttributeError
            If a joint lacks the attribute.
        """
        value = attrgetter(field)
        return np.array([value(joint) for joint in self.joints], dtype=float)

    def absolute_encoders(self, default: str) -> tuple[bool, ...]:
        """Return whether each encoder is absolute; `default` is the type for boards without one."""
        return tuple(
            (self.boards[joint.board].encoders or default) == 'absolute' for joint in self.joints
        )

    def with_encoders(self, kind: str) -> 'ArmConfig':
        """Return a copy in which all boards have encoders of the type `kind`, one of `ENCODERS`."""
        return replace(self, boards=tuple(replace(board, encoders=kind) for board in self.boards))

    def with_prefix(self, prefix: str) -> 'ArmConfig':
        """Return a copy with a prefix added to every joint name."""
        return replace(
            self,
            joints=tuple(replace(joint, name=prefix + joint.name) for joint in self.joints),
            coupled_joints=tuple(
                (prefix + joint, prefix + driver) for joint, driver in self.coupled_joints
            ),
        )

    def _check_channels(self) -> None:
        taken: dict[tuple[int, int], str] = {}
        for joint in self.joints:
            if joint.board >= len(self.boards):
                raise ConfigError(
                    f'joint {joint.name}: board = {joint.board}, but the list boards has only '
                    f'{len(self.boards)} entries (numbered from 0); correct the number'
                )
            place = (joint.board, joint.channel)
            if place in taken:
                raise ConfigError(
                    f'joint {joint.name}: board {joint.board}, channel {joint.channel} is '
                    f'already used by joint {taken[place]}; correct board or channel of one of '
                    'them'
                )
            taken[place] = joint.name

    def _check_rest_position(self) -> None:
        if len(self.rest_position) != self.n:
            raise ConfigError(
                f'arm: rest_position has {len(self.rest_position)} values for {self.n} '
                'joints; give one per joint'
            )
        for joint, value in zip(self.joints, self.rest_position, strict=True):
            key = f'rest_position of {joint.name}'
            check_range('arm', key, value, joint.position_min, joint.position_max, 'rad')

    def _check_coupled_joints(self) -> None:
        for joint, driver in self.coupled_joints:
            if joint == driver or not {joint, driver} <= set(self.joint_names):
                raise ConfigError(
                    f'arm: coupled_joints: {joint} and {driver} must be two different joints of '
                    f'{", ".join(self.joint_names)}'
                )

    def _check_rated_payload(self) -> None:
        if len(self.rated_payload) != 4:
            raise ConfigError(
                f'arm: rated_payload = {self.rated_payload} must be a list of four '
                'numbers: mass, and x, y and z of the centre of mass'
            )
        check_range('arm', 'mass of rated_payload', self.rated_payload[0], 0.0, 100.0, 'kg')
        for value in self.rated_payload[1:]:
            check_range('arm', 'centre of rated_payload', value, -10.0, 10.0, 'm')


def load_arm_config(path: Path | str | None = None) -> ArmConfig:
    """Read the drive train configuration of an arm.

    Parameters
    ----------
    path : Path or str, optional
        YAML file in the format of the packaged config/aerarm.yaml, which is the default.

    Raises
    ------
    ConfigError
        If the file cannot be read or is invalid; the one-line message names file and key.
    """
    return load(path, 'aerarm.yaml', _arm)


def _arm(document: dict[str, Any]) -> ArmConfig:
    check_keys('top level', document, ArmConfig, also=('motors', 'gears'))
    motors = {
        name: _motor(f'motors.{name}', entry, name)
        for name, entry in section(document, 'motors', dict).items()
    }
    gears = {
        kind: build(GearConfig, f'gears.{kind}', entry, kind=kind)
        for kind, entry in section(document, 'gears', dict).items()
    }
    joints = [
        _joint(f'joints[{index}]', entry, motors, gears)
        for index, entry in enumerate(section(document, 'joints', list))
    ]
    boards = [
        build(BoardConfig, f'boards[{index}]', entry)
        for index, entry in enumerate(section(document, 'boards', list))
    ]
    plain = {key: value for key, value in document.items() if key not in ('motors', 'gears')}
    plain.update(joints=tuple(joints), boards=tuple(boards))
    plain['coupled_joints'] = _coupled_joints(document.get('coupled_joints', []))
    stage = document.get('power_stage', {})
    plain['power_stage'] = build(PowerStageConfig, 'power_stage', stage)
    return build(ArmConfig, 'top level', plain)


def _motor(where: str, entry: Any, name: str) -> MotorConfig:
    if isinstance(entry, dict) and entry.get('thermal') is not None:
        thermal = build(ThermalConfig, f'{where}.thermal', entry['thermal'])
        entry = {**entry, 'thermal': thermal}
    return build(MotorConfig, where, entry, name=name)


def _joint(
    where: str, entry: Any, motors: dict[str, MotorConfig], gears: dict[str, GearConfig]
) -> JointConfig:
    check_keys(where, entry, JointConfig)
    parts = {
        'motor': _part(where, 'motor', entry, motors),
        'gear': _part(where, 'gear', entry, gears),
    }
    return build(JointConfig, where, {**entry, **parts})


def _coupled_joints(entries: Any) -> tuple[tuple[str, str], ...]:
    pairs = entries if isinstance(entries, list) else [entries]
    for pair in pairs:
        if not (
            isinstance(pair, list) and len(pair) == 2 and all(isinstance(x, str) for x in pair)
        ):
            raise ConfigError(
                f'coupled_joints: {pair!r} must be a pair [joint, driver] of joint names'
            )
    return tuple((joint, driver) for joint, driver in pairs)


def _part(where: str, key: str, entry: dict[str, Any], known: Mapping[str, object]) -> object:
    name = entry[key]
    if not isinstance(name, str) or name not in known:
        listed = ', '.join(map(str, known))
        raise ConfigError(f'{where}: {key} = {name!r} must be one of the {key}s {listed}')
    return known[name]


class DriveTrain:
    """Conversion between joint and motor quantities, thesis (4.2), (4.6) and (4.7).

    All arrays are (n,) or (..., n), in the order of `config.joint_names`. With the sign `s` and the
    offset `o` of a joint::

        q = s k_g theta_m + o        dq = s k_g dtheta_m        tau = s (K_i eta / k_g) i_q

    Attributes
    ----------
    reflected_inertia : (n,) ndarray
        Rotor inertia reflected to each joint, J_m / k_g^2 [kg m^2].
    """

    def __init__(self, config: ArmConfig) -> None:
        signs = config.column('sign')
        self._joint_per_motor = signs * config.column('gear.ratio')
        self._motor_per_joint = 1.0 / self._joint_per_motor
        self._offset = config.column('offset')
        self._effort_per_current = signs * config.column('torque_per_ampere')
        self._current_per_effort = 1.0 / self._effort_per_current
        # A gain relates a current to a motor angle; both change sign with the joint's sign, so
        # the gain has none.
        self._joint_gain_per_motor_gain = self._effort_per_current / self._joint_per_motor
        self.reflected_inertia = config.column('reflected_inertia')

    def motor_to_joint_position(self, motor_position: Array) -> Array:
        """Return the joint positions [rad] for motor positions [rad]."""
        return self._joint_per_motor * motor_position + self._offset

    def joint_to_motor_position(self, q: Array) -> Array:
        """Return the motor positions [rad] for joint positions [rad]."""
        return (q - self._offset) * self._motor_per_joint

    def motor_to_joint_velocity(self, motor_velocity: Array) -> Array:
        """Return the joint velocities [rad/s] for motor velocities [rad/s], thesis (4.6)."""
        return self._joint_per_motor * motor_velocity

    def joint_to_motor_velocity(self, dq: Array) -> Array:
        """Return the motor velocities [rad/s] for joint velocities [rad/s], thesis (4.6)."""
        return self._motor_per_joint * dq

    def current_to_effort(self, current: Array) -> Array:
        """Return the joint torques [Nm] for quadrature currents [A], thesis (4.2) and (4.7)."""
        return self._effort_per_current * current

    def effort_to_current(self, effort: Array) -> Array:
        """Return the quadrature currents [A] for joint torques [Nm], thesis (4.2) and (4.7)."""
        return self._current_per_effort * effort

    def motor_to_joint_gain(self, gain: Array) -> Array:
        """Return the joint-side gains for motor-side gains of the boards, thesis (4.4).

        Board gains in [A/rad] and [A s/rad] become joint gains in [Nm/rad] and [Nms/rad].
        """
        return self._joint_gain_per_motor_gain * gain

    def joint_to_motor_gain(self, gain: Array) -> Array:
        """Return the motor-side gains of the boards, thesis (4.4), for joint-side gains."""
        return gain / self._joint_gain_per_motor_gain
