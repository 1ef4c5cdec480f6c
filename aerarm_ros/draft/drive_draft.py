"""What one joint's URDF limits let one suppose of its drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

from aerarm_ros.description.description_error import DescriptionError
from aerarm_ros.description.gear_config import GearConfig
from aerarm_ros.description.joint_config import JointConfig
from aerarm_ros.description.motor_config import MotorConfig, ThermalConfig, torque_constant
from aerarm_ros.description.robot import Robot

_RATIO = 1.0 / 50.0  # of printed and of harmonic gears: 1/27 to 1/101
_CURRENT_MAX = 10.0  # [A]; frames hold 32
_POLE_PAIRS = 12
_RESISTANCE = 0.2  # [ohm]
# Of the effort limit: rotors as joints feel them [s^2], dry friction, friction that grows with
# speed, at full speed. The drives of config/aerarm.yaml have 0.001, 0.011 to 0.016 and 0.002.
_ROTOR_SHARE, _COULOMB_SHARE, _VISCOUS_SHARE = 0.002, 0.015, 0.005
_EFFORT_RISE = 1.0 / 60.0  # [s] from nothing to all
_ACCELERATION_TIME = 0.1  # [s] to full speed, at least
# Where a URDF gives no limit, or one that no drive has.
_RANGE, _VELOCITY, _LOAD_FACTOR = 3.14, 2.0, 3.0
_WIDEST, _FASTEST, _STRONGEST = 12.6, 20.0, 1000.0

GEAR = 'guessed'
# What a URDF may say of a joint; all else of `JointConfig` but the name is a guess.
OF_URDF = ('position_min', 'position_max', 'velocity_max', 'effort_max', 'viscous', 'coulomb')


@dataclass(frozen=True)
class DriveDraft:
    """A joint, and which of its values are guesses.

    Attributes
    ----------
    joint : JointConfig
        Gains and acceleration limit are placeholders, to be replaced once the whole arm is known.
    guesses : frozenset of str
        Names of its fields.
    """

    joint: JointConfig
    guesses: frozenset[str]

    @classmethod
    def of(cls, robot: Robot, number: int, load: float) -> DriveDraft:
        """Return what the URDF says of a joint, and guesses of the rest.

        Parameters
        ----------
        robot : Robot
        number : int
            Of the joint, from 0 at the base; two joints share a board.
        load : float
            The most that gravity asks of it [Nm].

        Raises
        ------
        DescriptionError
            If its effort limit does not hold the arm.
        ConfigError
            If a limit of the URDF can be no joint's.
        """
        joint = robot.joints[number]
        found = {
            'velocity_max': _usable(robot.velocity_max[number], _FASTEST),
            'effort_max': _usable(robot.effort_max[number], _STRONGEST),
            'viscous': _usable(joint.damping, math.inf),
            'coulomb': _usable(joint.friction, math.inf),
        }
        low, high = float(robot.position_min[number]), float(robot.position_max[number])
        if abs(low) <= _WIDEST and abs(high) <= _WIDEST:
            found |= {'position_min': low, 'position_max': high}
        known = {key: value for key, value in found.items() if value is not None}
        effort = known.setdefault('effort_max', _two_digits(max(_LOAD_FACTOR * load, 0.1)))
        if effort <= load:
            raise DescriptionError(
                f'joint {joint.name}: its effort limit of {effort:g} Nm does not hold the arm '
                f'stretched out, {load:.3g} Nm: check its <limit> and the masses'
            )
        guesses = {field for field in JointConfig.__dataclass_fields__ if field != 'name'}
        guesses -= found.keys() - {key for key, value in found.items() if value is None}
        return cls(_joint(joint.name, number, known), frozenset(guesses))


def require_turning(robot: Robot) -> None:
    """Raise DescriptionError unless all joints turn."""
    for joint in robot.joints:
        if joint.kind == 'prismatic':
            raise DescriptionError(
                f'joint {joint.name} slides, the drives here turn: hold it with --locked '
                f'{joint.name}'
            )


def _joint(name: str, number: int, known: dict[str, float]) -> JointConfig:
    effort = known['effort_max']
    velocity = known.get('velocity_max', _VELOCITY)
    return JointConfig(
        name=name,
        motor=_motor(effort),
        gear=GearConfig(GEAR, _RATIO),
        board=number // 2,
        channel=number % 2,
        sign=1,
        offset=0.0,
        position_min=known.get('position_min', -_RANGE),
        position_max=known.get('position_max', _RANGE),
        velocity_max=velocity,
        acceleration_max=velocity / _ACCELERATION_TIME,
        effort_max=effort,
        effort_rate_max=_two_digits(effort / _EFFORT_RISE),
        viscous=known.get('viscous', _two_digits(_VISCOUS_SHARE * effort / velocity)),
        coulomb=known.get('coulomb', _two_digits(_COULOMB_SHARE * effort)),
        board_kp=0.0,
        board_kd=0.0,
    )


def _motor(effort: float) -> MotorConfig:
    """Return a motor that gives a joint this torque [Nm] through the guessed gear."""
    constant = effort * _RATIO / _CURRENT_MAX
    return MotorConfig(
        name=f'for_{effort:g}_Nm',
        pole_pairs=_POLE_PAIRS,
        kv=float(f'{torque_constant(1.0) / constant:.4g}'),
        current_max=_CURRENT_MAX,
        rotor_inertia=_two_digits(_ROTOR_SHARE * effort * _RATIO**2),
        resistance=_RESISTANCE,
        thermal=ThermalConfig.guessed(_CURRENT_MAX),
    )


def _usable(value: float, most: float) -> float | None:
    """Return a number that a URDF gives, None where it stands for nothing."""
    return float(value) if 0.0 < value <= most else None


def _two_digits(value: float) -> float:
    return float(f'{value:.2g}')
