"""The true physical parameters of a simulated arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import PARAMETER_NAMES, from_pseudo_inertia, pseudo_inertia

Array = NDArray[np.float64]

# Share of the transmitted torque that a gear loses. Printed plastic; a cycloidal gear moves by
# friction between its discs (thesis 4.2), so it loses more.
LOAD_FRICTION: Mapping[str, float] = {'cycloidal': 0.04, 'herringbone': 0.02}
_OTHER_GEAR = 0.03


@dataclass(frozen=True)
class Spread:
    """How far a made arm may lie from its drawing; each deviation is uniform in +- its entry.

    Attributes
    ----------
    mass, stretch
        Relative change of a link's mass, and of its extent along and across its axes.
    shift
        Shift of a link's material [m].
    viscous, coulomb, rotor_inertia, torque_constant
        Relative changes of joint friction and motor data.
    """

    mass: float = 0.25
    stretch: float = 0.10
    shift: float = 0.010
    viscous: float = 0.30
    coulomb: float = 0.30
    rotor_inertia: float = 0.20
    torque_constant: float = 0.02


@dataclass(frozen=True, eq=False)
class PlantParameters:
    """What the simulated arm is really made of; joint side unless the name says motor.

    Attributes
    ----------
    joint_names, link_names
        The n joints from base to tool, and the links they move, by their names in the arm's files.
    inertial_parameters
        (n, 10) in the order of thesis (3.3), about the links' frames.
    rotor_inertia
        (n,) reflected to the joints, J_m / k_g^2 [kg m^2].
    viscous, coulomb
        (n,) [Nms/rad], [Nm].
    load_friction
        (n,) Coulomb friction per transmitted torque [-].
    motor_torque_constant
        (n,) K_i [Nm/A].
    motor_torque_constant_nominal
        (n,) the K_i that the configuration states [Nm/A].
    seed
        Seed of the deviations, None for an arm as drawn.
    backlash
        (n,) how far each link may turn while its rotor rests [rad]; None for gears without play,
        and only `BacklashPlant` has any.
    backlash_wear
        Growth of it per energy that the gear passes on [rad/J].
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    inertial_parameters: Array
    rotor_inertia: Array
    viscous: Array
    coulomb: Array
    load_friction: Array
    motor_torque_constant: Array
    motor_torque_constant_nominal: Array
    seed: int | None = None
    backlash: Array | None = None
    backlash_wear: float = 0.0

    @classmethod
    def nominal(cls, config: ArmConfig, robot: Robot) -> 'PlantParameters':
        """Return the parameters that URDF and configuration state.

        Raises ValueError if the two do not name the same joints.
        """
        if config.joint_names != robot.joint_names:
            raise ValueError(
                f'the configuration has joints {config.joint_names}, the URDF {robot.joint_names}: '
                'give both for the same arm'
            )
        torque_constant = config.column('motor.torque_constant')
        kinds = [joint.gear.kind for joint in config.joints]
        return cls(
            joint_names=tuple(map(robot.own_name, robot.joint_names)),
            link_names=tuple(map(robot.own_name, robot.link_names)),
            inertial_parameters=np.array(robot.inertial_parameters),
            rotor_inertia=config.column('reflected_inertia'),
            viscous=config.column('viscous'),
            coulomb=config.column('coulomb'),
            load_friction=np.array([LOAD_FRICTION.get(kind, _OTHER_GEAR) for kind in kinds]),
            motor_torque_constant=torque_constant,
            motor_torque_constant_nominal=torque_constant,
        )

    def without_friction(self) -> 'PlantParameters':
        """Return the parameters of an arm whose joints have no friction at all."""
        zero = np.zeros(len(self.joint_names))
        return replace(self, viscous=zero, coulomb=zero, load_friction=zero)

    def carrying(self, mass: float, centre: Sequence[float], radius: float) -> 'PlantParameters':
        """Return the parameters with a homogeneous ball fixed to the last link.

        Parameters
        ----------
        mass
            [kg], not negative.
        centre
            (3,) in the frame of the last link's joint [m].
        radius
            Of the ball [m].
        """
        point = np.append(np.asarray(centre, dtype=float), 1.0)
        ball = np.outer(point, point) + np.diag([*[0.2 * radius**2] * 3, 0.0])
        inertial = np.array(self.inertial_parameters)
        inertial[-1] += from_pseudo_inertia(mass * ball)
        return replace(self, inertial_parameters=inertial)

    def perturbed(self, seed: int, spread: Spread | None = None) -> 'PlantParameters':
        """Return an arm that differs from this one as a made arm differs from its drawing.

        Each link's matter is stretched and shifted by an affine map x -> A x + b and made
        denser by a factor s. Its pseudo-inertia becomes s T P T' with T = [[A, b], [0, 1]],
        which stays positive semidefinite: some real body has the new parameters too.

        Parameters
        ----------
        seed
            Equal seeds give equal arms.
        spread
            Bounds of the deviations, the defaults of `Spread` if not given.
        """
        spread = spread or Spread()
        random = np.random.default_rng(seed)
        n = len(self.joint_names)

        def factor(bound: float) -> Array:
            return 1.0 + bound * random.uniform(-1.0, 1.0, n)

        density = factor(spread.mass)
        transform = np.tile(np.eye(4), (n, 1, 1))
        stretch = random.uniform(-1.0, 1.0, (n, 3, 3))
        transform[:, :3, :3] += spread.stretch * 0.5 * (stretch + stretch.transpose(0, 2, 1))
        transform[:, :3, 3] = spread.shift * random.uniform(-1.0, 1.0, (n, 3))
        moments = transform @ pseudo_inertia(self.inertial_parameters)
        moments = density[:, None, None] * (moments @ transform.transpose(0, 2, 1))
        return replace(
            self,
            inertial_parameters=from_pseudo_inertia(moments),
            viscous=self.viscous * factor(spread.viscous),
            coulomb=self.coulomb * factor(spread.coulomb),
            rotor_inertia=self.rotor_inertia * factor(spread.rotor_inertia),
            motor_torque_constant=self.motor_torque_constant * factor(spread.torque_constant),
            seed=seed,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers for a YAML file.

        `parameters` names them as the regressor's columns do: `m_link1`, `fv_joint1`,
        `fs_joint1`, `Ja_joint1`. `measured_per_true_torque` is the factor by which torques
        computed from measured currents are too large, because the configuration's torque
        constant is not the motor's: identification from currents finds the parameters of a
        joint's torque equation times this factor.
        """
        parameters = {
            f'{name}_{link}': float(value)
            for link, row in zip(self.link_names, self.inertial_parameters, strict=True)
            for name, value in zip(PARAMETER_NAMES, row, strict=True)
        }
        columns = (('fv', self.viscous), ('fs', self.coulomb), ('Ja', self.rotor_inertia))
        for prefix, values in columns:
            for joint, value in zip(self.joint_names, values, strict=True):
                parameters[f'{prefix}_{joint}'] = float(value)
        ratio = self.motor_torque_constant_nominal / self.motor_torque_constant
        play = {} if self.backlash is None else {'backlash': np.asarray(self.backlash).tolist()}
        return {
            'seed': self.seed,
            'joint_names': list(self.joint_names),
            'link_names': list(self.link_names),
            'parameters': parameters,
            'load_friction': self.load_friction.tolist(),
            'motor_torque_constant': self.motor_torque_constant.tolist(),
            'measured_per_true_torque': ratio.tolist(),
            **play,
        }
