"""Draft of an arm's configuration: values from its URDF, and guesses for all other values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig, BoardConfig, DriveTrain
from aerarm_ros.description.config_reader import ConfigError, DescriptionError, read_yaml
from aerarm_ros.description.drive_config import (
    GearConfig,
    JointConfig,
    MotorConfig,
    ThermalConfig,
    torque_constant,
)
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import ExcitationConfig, ExcitationError
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.model.dynamics import Dynamics, largest_gravity_load
from aerarm_ros.motion.signals import Array

_RATIO = 1.0 / 50.0  # gear ratio: printed and harmonic gears have ratios of 1/27 to 1/101
_CURRENT_MAX = 10.0  # [A] largest motor current; SPI frames represent up to 32 A
_POLE_PAIRS = 12
_RESISTANCE = 0.2  # [ohm]
# Relative to the effort limit: reflected rotor inertia [s^2], dry friction, and viscous friction at
# full speed. The drives of config/aerarm.yaml have 0.001, 0.011 to 0.016 and 0.002.
_ROTOR_SHARE, _COULOMB_SHARE, _VISCOUS_SHARE = 0.002, 0.015, 0.005
_EFFORT_RISE = 1.0 / 60.0  # [s] time from zero to the full effort limit
_ACCELERATION_TIME = 0.1  # [s] shortest time from rest to the velocity limit
# Default limits, used if the URDF has no limit or an implausible one.
_RANGE, _VELOCITY, _LOAD_FACTOR = 3.14, 2.0, 3.0
_WIDEST, _FASTEST, _STRONGEST = 12.6, 20.0, 1000.0

GEAR = 'guessed'
_IDENTIFIED = ('viscous', 'coulomb', 'rotor_inertia')


def read_drives(path: Path, joint_names: Sequence[str]) -> dict[str, Array]:
    """Read friction and rotor inertia of the joints from the identifier's estimate.yaml.

    Returns
    -------
    dict
        'viscous': viscous friction (n,) [Nms/rad]; 'coulomb': Coulomb friction (n,) [Nm];
        'rotor_inertia': rotor inertia (n,) at the joints [kg m^2].

    Raises
    ------
    ConfigError
        If the file cannot be read, is not an estimate, or belongs to another arm.
    """
    document = read_yaml(path)
    try:
        parameters = document['/**']['ros__parameters']
        names = list(parameters['joint_names'])
        columns = {key: np.array(parameters[key], dtype=float) for key in _IDENTIFIED}
        values = np.stack([*columns.values(), np.zeros(len(names))])
        is_valid = bool(np.isfinite(values).all()) and values.min(initial=0.0) >= 0.0
    except (KeyError, TypeError, ValueError):
        is_valid = False
    if not is_valid:
        raise ConfigError(f'{path} is not an estimate: pass the estimate.yaml of the identifier')
    missing = [name for name in joint_names if name not in names]
    if missing:
        raise ConfigError(
            f'{path} has the joints {", ".join(names)}, but not {", ".join(missing)}: pass '
            'the estimate of this arm'
        )
    order = [names.index(name) for name in joint_names]
    return {key: column[order] for key, column in columns.items()}


class DriveDraft(NamedTuple):
    """Drafted configuration of one joint, with a list of the values that are guesses.

    Attributes
    ----------
    joint : JointConfig
        Configuration of the joint. Gains and acceleration limit are placeholders until the whole
        arm is known.
    guesses : frozenset of str
        Names of guessed fields.
    rotor_is_known : bool
        Whether the motor's rotor inertia is known.
    """

    joint: JointConfig
    guesses: frozenset[str]
    rotor_is_known: bool


def draft_drive(
    robot: Robot, number: int, load: float, identified: Mapping[str, Array] | None = None
) -> DriveDraft:
    """Return the drafted drive of a joint, from its limits in the URDF and guesses.

    Parameters
    ----------
    number : int
        Number of the joint, from 0 at the base; two joints share a board.
    load : float
        Largest gravity torque of the joint [Nm].
    identified : mapping, optional
        Identified friction and rotor inertia, see `read_drives`.

    Raises
    ------
    DescriptionError
        If the effort limit is too small to hold the arm.
    ConfigError
        If a limit of the URDF is invalid.
    """
    joint = robot.joints[number]
    limits = {
        'velocity_max': (robot.velocity_max[number], _FASTEST),
        'effort_max': (robot.effort_max[number], _STRONGEST),
        'viscous': (joint.damping, math.inf),
        'coulomb': (joint.friction, math.inf),
    }
    known = {key: float(value) for key, (value, most) in limits.items() if 0.0 < value <= most}
    low, high = float(robot.position_min[number]), float(robot.position_max[number])
    if abs(low) <= _WIDEST and abs(high) <= _WIDEST:
        known |= {'position_min': low, 'position_max': high}
    if identified is not None:
        known |= {key: _digits(identified[key][number], 4) for key in ('viscous', 'coulomb')}
    guesses = JointConfig.__dataclass_fields__.keys() - {'name', *known}
    effort = known.setdefault('effort_max', _digits(max(_LOAD_FACTOR * load, 0.1), 2))
    if effort <= load:
        raise DescriptionError(
            f'joint {joint.name}: the effort limit of {effort:g} Nm is below the {load:.3g} Nm '
            'that hold the outstretched arm; check its <limit> and the masses'
        )
    motor, rotor = _motor(effort), 0.0
    if identified is not None:
        motor = replace(motor, name=f'of_{joint.name}')
        # With torque sensors behind the gears, the identified rotor inertia is zero, although the
        # rotor exists.
        rotor = float(identified['rotor_inertia'][number])
        if rotor > 0.0:
            motor = replace(motor, rotor_inertia=_digits(rotor * _RATIO**2, 4))
    return DriveDraft(_joint(joint.name, number, motor, known), frozenset(guesses), rotor > 0.0)


def _joint(name: str, number: int, motor: MotorConfig, known: dict[str, float]) -> JointConfig:
    effort, velocity = known['effort_max'], known.setdefault('velocity_max', _VELOCITY)
    values: dict[str, float] = {
        'position_min': -_RANGE,
        'position_max': _RANGE,
        'viscous': _digits(_VISCOUS_SHARE * effort / velocity, 2),
        'coulomb': _digits(_COULOMB_SHARE * effort, 2),
        **known,
    }
    return JointConfig(
        name=name,
        motor=motor,
        gear=GearConfig(GEAR, _RATIO),
        board=number // 2,
        channel=number % 2,
        sign=1,
        offset=0.0,
        acceleration_max=velocity / _ACCELERATION_TIME,
        effort_rate_max=_digits(effort / _EFFORT_RISE, 2),
        board_kp=0.0,
        board_kd=0.0,
        **values,
    )


def _motor(effort: float) -> MotorConfig:
    """Return a motor that delivers the joint torque `effort` [Nm] through the guessed gear."""
    constant = effort * _RATIO / _CURRENT_MAX
    return MotorConfig(
        name=f'for_{effort:g}_Nm',
        pole_pairs=_POLE_PAIRS,
        kv=_digits(torque_constant(1.0) / constant, 4),
        current_max=_CURRENT_MAX,
        rotor_inertia=_digits(_ROTOR_SHARE * effort * _RATIO**2, 2),
        resistance=_RESISTANCE,
        thermal=ThermalConfig.guessed(_CURRENT_MAX),
    )


def _digits(value: float, digits: int) -> float:
    return float(f'{value:.{digits}g}')


_POSTURES = 200
# The boards filter speed with a low-pass of 100 Hz. A velocity loop (4.5) below half of that is
# damped; a factor of 0.4 leaves a margin for links lighter than nominal.
_BANDWIDTH = 0.4 * 2.0 * math.pi * 100.0  # [1/s]
_BANDWIDTH_MAX = 0.5 / 0.4 * _BANDWIDTH
_FASTEST_RATE = 25.0  # [1/s] largest rate at which a board corrects a position error
_AMPLE = 1.1  # factor above the least damping, because frames round the gain


def draft_gains(robot: Robot, rotor_inertia: Array, damping_min: Array) -> tuple[Array, Array]:
    """Return stiffness K [Nm/rad] and damping D [Nms/rad] of the boards' loops, (n,) each.

    D is the largest damping for which all eigenvalues of M^-1 D stay below the bandwidth of the
    boards' velocity loop in every tested posture; M(q) is the inertia matrix. K = r D, with r at
    most a quarter of the smallest eigenvalue, so M ddq + D dq + K q = 0 does not overshoot.

    Parameters
    ----------
    robot
        Nominal robot model.
    rotor_inertia
        (n,) inertia reflected to the joints [kg m^2].
    damping_min
        (n,) least damping of a stopped arm [Nms/rad], see `JointLoads`.

    Raises
    ------
    ValueError
        If no damping satisfies both bounds, for example with massless links.
    """
    dynamics = Dynamics(robot, rotor_inertia)
    low, high = np.maximum(robot.position_min, -math.pi), np.minimum(robot.position_max, math.pi)
    postures = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    mobility: Array = np.array([dynamics.mobility_matrix(q) for q in postures])
    shares = 1.0 / np.diagonal(mobility, axis1=1, axis2=2).max(axis=0)
    damping = shares * _BANDWIDTH / _rates(mobility, shares)[1]
    damping = np.maximum(damping, _AMPLE * damping_min)
    slowest, fastest = _rates(mobility, damping)
    if fastest > _BANDWIDTH_MAX:
        raise ValueError(
            'holding the stopped arm against gravity needs a velocity loop with a bandwidth of '
            f'{fastest / (2.0 * math.pi):.0f} Hz, too fast for the boards: check masses and '
            'inertias of the last links, and velocity limits'
        )
    return min(_FASTEST_RATE, 0.25 * slowest) * damping, damping


def _rates(mobility: Array, damping: Array) -> tuple[float, float]:
    """Return the extreme eigenvalues [1/s] of mobility times damping, over all postures."""
    root = np.sqrt(damping)
    rates = np.linalg.eigvalsh(root[:, None] * mobility * root)
    return float(rates.min()), float(rates.max())


_TRIED_POSTURES = 400
# fraction of each joint's range, about its middle, from which postures are drawn, because an
# excitation needs room on both sides
_SHARE = 0.6
_CLEAR_ENOUGH = 0.5  # fraction of the largest clearance found, below which a posture is rejected
_NARROW = 0.01  # [m] clearance required if the requested clearances cannot be kept


class RestPosture(NamedTuple):
    """Home configuration, about which excitation motions are centred too.

    Attributes
    ----------
    q
        (n,) posture [rad], rounded to a tenth, within the limits.
    surroundings
        Requested surroundings, relaxed if no posture satisfies them: first clearances of 0.01 m,
        then no ground. Without readable shapes clearances are not checked.
    problem
        Reason why clearances were reduced or not checked, or a text that no posture is
        collision-free; otherwise ''.
    """

    q: Array
    surroundings: ExcitationConfig
    problem: str


def find_rest_posture(
    robot: Robot,
    config: ArmConfig,
    surroundings: ExcitationConfig,
    package_directories: Sequence[Path] = (),
) -> RestPosture:
    """Search for a home configuration.

    Random postures are drawn about the middle of the joint ranges. Among the postures with at
    least half of the largest clearance, the posture with the smallest holding torques is chosen.

    Parameters
    ----------
    robot, config
        Robot model, and configuration with position and effort limits.
    surroundings
        Ground and requested clearances.
    package_directories
        Folders for `package://` meshes, in addition to the folders above the URDF.
    """
    low = np.maximum(config.column('position_min'), -math.pi)
    high = np.minimum(config.column('position_max'), math.pi)
    checker, surroundings, problem = _checker(robot, surroundings, package_directories)
    dynamics = Dynamics(robot, np.zeros(robot.n))

    def rounded(q: Array) -> Array:
        return np.clip(np.round(q, 1) + 0.0, low, high)

    def margin(q: Array) -> float:
        return 0.0 if checker is None else checker.margin(q)

    def load(q: Array) -> float:
        """Return the largest ratio of gravity torque to effort limit of all joints."""
        return float(np.max(np.abs(dynamics.gravity(q)) / config.column('effort_max')))

    middle, half = 0.5 * (low + high), 0.5 * _SHARE * (high - low)
    drawn = np.random.default_rng(0).uniform(-half, half, (_TRIED_POSTURES, robot.n))
    postures = [rounded(q) for q in (middle, *(middle + drawn))]
    margins = [margin(q) for q in postures]
    best = max(margins)
    if best < 0.0:
        problem = (
            f'none of {len(postures)} random postures has the required clearance; the best '
            f'posture lacks {-best:.2g} m: check the collision shapes and ground_height'
        )
    enough = _CLEAR_ENOUGH * best if best > 0.0 else best
    clear = [q for q, own in zip(postures, margins, strict=True) if own >= enough]
    found = min(clear, key=load)
    # A joint that influences neither clearance nor holding torque stays in the middle of its
    # range, for example a vertical base joint.
    for joint in range(robot.n):
        other = found.copy()
        other[joint] = postures[0][joint]
        if margin(other) >= enough and load(other) <= load(found) + 1e-6:
            found = other
    return RestPosture(found, surroundings, problem)


def _checker(
    robot: Robot, requested: ExcitationConfig, package_directories: Sequence[Path]
) -> tuple[ClearanceChecker | None, ExcitationConfig, str]:
    """Return the checker of the requested surroundings, or else of the first that are possible."""
    near_ground = replace(requested, ground_clearance=_NARROW)
    near = replace(near_ground, self_clearance=_NARROW)
    problem = ''
    for one in (requested, near_ground, near, replace(near, ground_height=None)):
        clearances = (one.self_clearance, one.ground_clearance, one.ground_height)
        try:
            return ClearanceChecker(robot, *clearances, package_directories), one, problem
        except ExcitationError as error:
            problem = problem or str(error)
    return None, replace(requested, check_clearance=False), problem


PROFILE = 'uomodri_v3'
_CLOCK, _MODE = 8_000_000, 0
_CHIP_SELECTS = 2  # number of chip selects per SPI bus


class ArmDraft:
    """Draft of an arm's configuration, made without measurements.

    Parameters
    ----------
    robot : Robot
        Robot model; its gravity vector must match how the arm is mounted.
    name : str, optional
        Name of the arm; by default that of the URDF.
    package_directories : sequence of Path
        Folders for `package://` meshes, in addition to the folders above the URDF.
    identified : mapping, optional
        Identified friction and rotor inertia, used in place of guesses; see `read_drives`.

    Attributes
    ----------
    config : ArmConfig
        Configuration that passes the bridge's checks: SPI frames can represent the gains, and the
        drives can hold the arm.
    guesses : tuple of frozenset of str
        Names of the guessed fields per joint: neither URDF nor estimate provides them.
    known_rotors : tuple of bool
        Whether each joint's rotor inertia is from an estimate.
    excitation : ExcitationConfig
        Excitation settings, with motions about the home configuration.
    problem : str
        Reason why clearances were reduced or not checked; otherwise ''.

    Raises
    ------
    ValueError
        If no suitable drive can be guessed; the message names the URDF values to check.
    """

    def __init__(
        self,
        robot: Robot,
        name: str = '',
        package_directories: Sequence[Path] = (),
        identified: Mapping[str, Array] | None = None,
    ) -> None:
        for joint in robot.joints:
            if joint.kind == 'prismatic':
                raise DescriptionError(
                    f'joint {joint.name} is prismatic, but the drives are rotary: lock it with '
                    f'--locked {joint.name}'
                )
        loads = largest_gravity_load(robot)
        drives = [
            draft_drive(robot, number, float(load), identified) for number, load in enumerate(loads)
        ]
        self.guesses = tuple(drive.guesses for drive in drives)
        self.known_rotors = tuple(drive.rotor_is_known for drive in drives)
        joints = tuple(drive.joint for drive in drives)
        config = ArmConfig(
            name=name or re.sub(r'\W+', '_', str(robot.model.name)).strip('_') or 'arm',
            joints=joints,
            boards=tuple(_board(number) for number in range((len(joints) + 1) // 2)),
            profile=PROFILE,
            gravity_in_base=tuple(robot.gravity_in_base.tolist()),
            rest_position=tuple(0.5 * (j.position_min + j.position_max) for j in joints),
            emulated_only=True,
        )
        config = _with_dynamics(config, robot)
        # A hanging arm has no ground below its base.
        hangs = robot.gravity_in_base[2] > 0.0 or not robot.gravity_in_base.any()
        surroundings = ExcitationConfig(ground_height=None if hangs else 0.0)
        rest = find_rest_posture(robot, config, surroundings, package_directories)
        posture = tuple(rest.q.tolist())
        self.config = replace(config, rest_position=posture)
        self.excitation = replace(rest.surroundings, bias=posture)
        self.problem = rest.problem


def _board(number: int) -> BoardConfig:
    bus, chip = divmod(number, _CHIP_SELECTS)
    return BoardConfig(f'board{number}', f'/dev/spidev{bus}.{chip}', _CLOCK, _MODE)


def _with_dynamics(config: ArmConfig, robot: Robot) -> ArmConfig:
    """Return the configuration with gains and acceleration limits that suit the arm's inertia."""
    loads = JointLoads(config, robot)
    drive = DriveTrain(config)
    gains = draft_gains(robot, drive.reflected_inertia, loads.damping_min)
    stiffness, damping = map(drive.joint_to_motor_gain, gains)
    profile = load_profile(config.profile)
    rows = zip(
        config.joints,
        _rounded_down(loads.deceleration),
        _rounded_down(np.minimum(stiffness, profile.command.largest('kp'))),
        _rounded(np.minimum(damping, profile.command.largest('kd'))),
        strict=True,
    )
    joints = tuple(
        replace(joint, acceleration_max=acceleration, board_kp=kp, board_kd=kd)
        for joint, acceleration, kp, kd in rows
    )
    config = replace(config, joints=joints)
    reach = BridgeSettings().position_error_max
    MotorReferences(config, profile, reach, loads.damping_min)
    return config


def _rounded(values: Array) -> list[float]:
    return [_digits(value, 3) for value in values]


def _rounded_down(values: Array) -> list[float]:
    unit = 10.0 ** (np.floor(np.log10(values)) - 1.0)
    return _rounded(np.floor(values / unit) * unit)
