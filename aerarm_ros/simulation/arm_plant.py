"""Simulated arm on a fixed base, in the physics engine MuJoCo."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import (
    PARAMETER_NAMES,
    barycentric_inertia,
    from_pseudo_inertia,
    pseudo_inertia,
)
from aerarm_ros.motion.signals import Array

# Fraction of the transmitted torque that a gear loses, for printed plastic. A cycloidal gear moves
# by friction between its discs (thesis 4.2), so it loses more.
LOAD_FRICTION: Mapping[str, float] = {'cycloidal': 0.04, 'herringbone': 0.02}
_OTHER_GEAR = 0.03


@dataclass(frozen=True)
class Spread:
    """Bounds of the uniformly distributed deviations of a manufactured arm from its model.

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
    """True parameters of the simulated arm; those named `motor_` are on the motor side.

    Attributes
    ----------
    joint_names, link_names
        The n joints from base to tool, and the links they move, by their names in the arm's files.
    inertial_parameters
        (n, 10) in the order of thesis (3.3), about the links' frames.
    rotor_inertia
        (n,) rotor inertia reflected to the joints, J_m / k_g^2 [kg m^2].
    viscous, coulomb
        (n,) viscous [Nms/rad] and Coulomb friction [Nm] of the joints.
    load_friction
        (n,) Coulomb friction per transmitted torque [-].
    motor_torque_constant
        (n,) true torque constants K_i of the motors [Nm/A].
    motor_torque_constant_nominal
        (n,) torque constants K_i in the configuration [Nm/A].
    seed
        Seed of the deviations, None for a nominal arm.
    backlash
        (n,) angle by which each link may turn while its rotor rests [rad]; None for gears without
        backlash, required by `BacklashPlant` only.
    stribeck
        Static friction beyond that of a joint that slides, over the latter [-].
    stribeck_velocity
        Velocity at which a third of `stribeck` is left [rad/s].
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
    stribeck: float = 0.0
    stribeck_velocity: float = 0.05

    @classmethod
    def nominal(cls, config: ArmConfig, robot: Robot) -> 'PlantParameters':
        """Return the parameters as URDF and configuration specify them.

        Raises ValueError if URDF and configuration do not name the same joints.
        """
        if config.joint_names != robot.joint_names:
            raise ValueError(
                f'the configuration has joints {config.joint_names}, but the URDF has '
                f'{robot.joint_names}: pass files of the same arm'
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
        """Return a copy of these parameters with zero joint friction."""
        zero = np.zeros(len(self.joint_names))
        return replace(self, viscous=zero, coulomb=zero, load_friction=zero)

    def carrying(self, mass: float, centre: Sequence[float], radius: float) -> 'PlantParameters':
        """Return a copy of these parameters with a homogeneous ball fixed to the last link.

        Parameters
        ----------
        mass
            [kg], not negative.
        centre
            (3,) in the frame of the last link's joint [m].
        radius
            Radius of the ball [m].
        """
        point = np.append(np.asarray(centre, dtype=float), 1.0)
        ball = np.outer(point, point) + np.diag([*[0.2 * radius**2] * 3, 0.0])
        inertial = np.array(self.inertial_parameters)
        inertial[-1] += from_pseudo_inertia(mass * ball)
        return replace(self, inertial_parameters=inertial)

    def perturbed(self, seed: int, spread: Spread | None = None) -> 'PlantParameters':
        """Return parameters that deviate from these at random, as after manufacturing.

        Each link's material is stretched and shifted by an affine map x -> A x + b, and its
        density scaled by a factor s. The link's pseudo-inertia P becomes s T P T' with T = [[A,
        b], [0, 1]]. The result stays positive semidefinite, so the new parameters are physical.

        Parameters
        ----------
        seed
            Equal seeds give equal arms.
        spread
            Bounds of the deviations, by default those of `Spread`.
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
        """Return the parameters as plain numbers for a YAML file.

        `parameters` has the names of the regressor's columns: `m_link1`, `fv_joint1`, `fs_joint1`,
        `Ja_joint1`. The motor's torque constant differs from the configuration's. So torques
        computed from measured currents are too large by the factor `measured_per_true_torque`, and
        identification from currents finds a joint's parameters times this factor.
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
            'stribeck': self.stribeck,
            'stribeck_velocity': self.stribeck_velocity,
            'measured_per_true_torque': ratio.tolist(),
            **play,
        }


SUBSTEP = 0.25e-3  # [s] four in a cycle of 1 ms
_STOP_MARGIN = 0.1  # [rad] from the software limit to the mechanical stop
# MuJoCo's constraints are soft. With this stiffness, the largest that the sub-step permits, a
# joint held by dry friction moves by less than 1e-6 rad/s.
_FRICTION_SOLREF = (2.0 * SUBSTEP, 1.0)
_FRICTION_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
_STOP_SOLREF = (20.0 * SUBSTEP, 1.0)


class PlantError(ValueError):
    """Error: the physics engine cannot simulate this arm; the text states what to check."""


class ArmPlant:
    """Simulated arm with rotor inertia and with viscous, dry and load-dependent friction.

    The engine is MuJoCo, built from the URDF's kinematics and the given parameters, without the
    controllers' model. Equation of motion, thesis (2.7) with rotors::

        (B(q) + J_a) ddq + C(q, dq) dq + g(q) + f_v dq + friction = tau

    The dry friction of joint i is at most ``f_s + c |tau_t|``. The torque ``tau_t`` is the one
    that the gear transmitted in the previous sub-step. Dry friction is a constraint of the engine,
    not a function of speed, so a joint rests under any smaller load. With ``stribeck`` the
    limit is higher at low speed, by the factor ``1 + s exp(-(dq / v_s)^2)`` (Armstrong-Helouvry,
    Dupont, Canudas de Wit: A survey of models for the control of machines with friction,
    Automatica 1994), so that a joint that is moved slowly through a compliance sticks and slips.

    Parameters
    ----------
    robot
        Kinematics, joint limits and gravity of the arm; the mechanical stops are slightly beyond
        the limits.
    parameters
        True parameters of the arm.
    position
        Initial joint angles (n,) [rad]; zero by default.

    Raises
    ------
    PlantError
        If the engine rejects the arm.
    """

    def __init__(
        self, robot: Robot, parameters: PlantParameters, position: ArrayLike | None = None
    ) -> None:
        self.parameters = parameters
        self.n = robot.n
        self._model = self._engine_model(robot)
        self._data: Any = mujoco.MjData(self._model)
        self._gravity = np.array(robot.gravity_in_base, dtype=float)
        self._support = 0.0
        self._effort = np.zeros(self.n)
        # The engine's own arrays, used in place in every sub-step. The base's entries come first.
        joints = slice(-self.n, None)
        self._angle = self._data.qpos[joints]
        self._applied = self._data.qfrc_applied[joints]
        self._velocity = self._data.qvel[joints]
        self._acceleration = self._data.qacc[joints]
        self._constraint = self._data.qfrc_constraint[joints]
        self._friction_limit = self._model.dof_frictionloss[joints]
        self._load = np.zeros(self.n)
        columns = (
            parameters.rotor_inertia,
            parameters.viscous,
            parameters.coulomb,
            parameters.load_friction,
        )
        self._constants: list[list[float]] = np.transpose(columns).tolist()
        self._count = 0
        self._place_base()
        self._set_gravity()
        mujoco.mj_setConst(self._model, self._data)
        self.reset(np.zeros(self.n) if position is None else position)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._count * SUBSTEP

    @property
    def position(self) -> Array:
        """Copy of the joint angles (n,) [rad]."""
        return np.array(self._angle)

    @property
    def velocity(self) -> Array:
        """Copy of the joint velocities (n,) [rad/s]."""
        return np.array(self._velocity)

    @property
    def acceleration(self) -> Array:
        """Copy of the joint accelerations (n,) of the last sub-step [rad/s^2]."""
        return np.array(self._acceleration)

    @property
    def transmitted_effort(self) -> Array:
        """Copy of the torques (n,) that the gears transmitted in the last sub-step [Nm]."""
        return self._load.copy()

    @property
    def energy(self) -> float:
        """Sum of potential and kinetic energy of the arm, including its motor rotors [J]."""
        mujoco.mj_forward(self._model, self._data)
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(np.sum(self._data.energy))

    @property
    def gravity_in_base(self) -> Array:
        """Gravity (3,) [m/s^2] in the axes of the arm's base frame."""
        return self._gravity.copy()

    @gravity_in_base.setter
    def gravity_in_base(self, gravity: ArrayLike) -> None:
        self._gravity = np.array(gravity, dtype=float)
        self._set_gravity()

    @property
    def support(self) -> float:
        """Fraction of the arm's weight that an external support carries, 0 to 1."""
        return self._support

    @support.setter
    def support(self, share: float) -> None:
        self._support = min(max(share, 0.0), 1.0)
        self._set_gravity()

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set the joint angles (n,) [rad] and velocities (n,) [rad/s]; default zero."""
        mujoco.mj_resetData(self._model, self._data)
        self._angle[:] = position
        self._velocity[:] = 0.0 if velocity is None else velocity
        self._effort[:] = 0.0
        self._place_base()
        mujoco.mj_forward(self._model, self._data)
        self._set_friction()

    def restart(self, position: ArrayLike) -> None:
        """Restart with resting joints at these angles (n,) [rad], and the initial vehicle pose."""
        self.reset(position)

    def apply_effort(self, effort: ArrayLike) -> None:
        """Set the motor torques (n,) [Nm], as torques on the joint side."""
        self._effort[:] = effort

    def scale_friction(self, factors: Sequence[float]) -> None:
        """Multiply the dry friction of each joint by a factor (n,) from now on."""
        for row, coulomb, factor in zip(
            self._constants, self.parameters.coulomb.tolist(), factors, strict=True
        ):
            row[2] = factor * coulomb

    def grasp(self, parameters: PlantParameters) -> None:
        """Replace the inertia of the last link, as if the arm picked up a payload.

        The motion continues, because the payload already moved with the arm.

        Parameters
        ----------
        parameters
            Parameters of which only the last link's inertial ones are used.
        """
        pi = parameters.inertial_parameters[-1]
        moments, axes = np.linalg.eigh(barycentric_inertia(pi))
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] = -axes[:, 0]
        model, body = self._model, self._last_link()
        model.body_mass[body] = pi[0]
        model.body_ipos[body] = pi[1:4] / pi[0]
        model.body_inertia[body] = moments
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())
        # Update derived quantities; on other data, because the call sets the joints to zero.
        mujoco.mj_setConst(model, mujoco.MjData(model))
        inertial = np.array(self.parameters.inertial_parameters)
        inertial[-1] = pi
        self.parameters = replace(self.parameters, inertial_parameters=inertial)

    def link_pose(self, link: str) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) [m] of a moving link's frame in the world.

        Raises
        ------
        KeyError
            If no moving link has that name.
        """
        # The joint positions are those after the last sub-step, the engine's poses those before
        # it.
        mujoco.mj_kinematics(self._model, self._data)
        body = self._data.body(self._body_name(link))
        return np.array(body.xmat).reshape(3, 3), np.array(body.xpos)

    def step(self) -> None:
        """Simulate one sub-step of 0.25 ms."""
        self._applied[:] = self._effort
        mujoco.mj_step(self._model, self._data)
        self._count += 1
        self._set_friction()

    def advance(self, seconds: float) -> None:
        """Simulate `seconds` [s], rounded to whole sub-steps, with constant motor torques."""
        for _ in range(round(seconds / SUBSTEP)):
            self.step()

    def true_parameters(self) -> dict[str, Any]:
        """Return the true parameters of the arm and gravity, for a YAML file."""
        return {**self.parameters.as_dict(), 'gravity_in_base': self._gravity.tolist()}

    # Methods that a plant with its own base overrides.

    def _engine_model(self, robot: Robot) -> Any:
        return _fixed_base_model(robot, self.parameters)

    def _last_link(self) -> int:
        """Return the number of the arm's last link in the physics engine."""
        return int(self._model.jnt_bodyid[-1])

    def _body_name(self, link: str) -> str:
        """Return the name of a link in the physics engine."""
        return link

    def _stribeck(self, dq: float) -> float:
        """Return the ratio of dry friction at a velocity [rad/s] to dry friction at high speed."""
        share = self.parameters.stribeck
        if share == 0.0:
            return 1.0
        ratio = dq / self.parameters.stribeck_velocity
        return 1.0 + share * exp(-min(ratio * ratio, 50.0))

    def _set_gravity(self) -> None:
        """Set gravity in the physics engine to the fraction that no external support carries."""
        self._model.opt.gravity = (1.0 - self._support) * self._gravity

    def _place_base(self) -> None:
        """Set the pose of a moving base in the physics engine; do nothing for a fixed base."""

    def _set_friction(self) -> None:
        """Update the gears' dry friction, which depends on the transmitted torques."""
        # Plain numbers: for few joints they are faster than a dozen array operations.
        rows = zip(
            self._constants,
            self._effort.tolist(),
            self._velocity.tolist(),
            self._acceleration.tolist(),
            self._constraint.tolist(),
            strict=True,
        )
        load, limit = [], []
        for (inertia, viscous, coulomb, share), effort, dq, ddq, constraint in rows:
            transmitted = effort - inertia * ddq - viscous * dq + constraint
            load.append(transmitted)
            limit.append((coulomb + share * abs(transmitted)) * self._stribeck(dq))
        self._load[:] = load
        self._friction_limit[:] = limit


def _fixed_base_model(robot: Robot, parameters: PlantParameters) -> Any:
    try:
        model = mujoco.MjModel.from_xml_string(bare_urdf(robot, parameters))
    except ValueError as error:
        raise PlantError(f'the physics engine rejects the arm: {error}') from None
    names = [model.joint(index).name for index in range(model.njnt)]
    if tuple(names) != robot.joint_names:
        raise PlantError(
            f'the physics engine moves joints {names}, but the arm has '
            f'{list(robot.joint_names)}: locked joints cannot be simulated'
        )
    model.opt.timestep = SUBSTEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.dof_armature[:] = parameters.rotor_inertia
    model.dof_damping[:] = parameters.viscous
    model.dof_solref[:] = _FRICTION_SOLREF
    model.dof_solimp[:] = _FRICTION_SOLIMP
    model.jnt_solref[:] = _STOP_SOLREF
    model.jnt_range += (-_STOP_MARGIN, _STOP_MARGIN)
    return model


def copy_settings(fixed: Any, model: Any, dofs: slice, joints: slice) -> None:
    """Copy solver options and settings of the joints to a model with other bodies and joints."""
    for option in ('timestep', 'integrator', 'solver', 'disableflags'):
        setattr(model.opt, option, getattr(fixed.opt, option))
    for array in ('armature', 'damping', 'solref', 'solimp'):
        getattr(model, f'dof_{array}')[dofs] = getattr(fixed, f'dof_{array}')
    for array in ('solref', 'range'):
        getattr(model, f'jnt_{array}')[joints] = getattr(fixed, f'jnt_{array}')


def bare_urdf(robot: Robot, parameters: PlantParameters) -> str:
    """Return a URDF that contains only the robot's kinematics and the given inertias.

    The URDF has no shapes, because there are no contacts, and no friction, because the plant has
    its own. `parameters` includes the inertia of fixed links in the links that carry them.
    """
    root = ElementTree.fromstring(robot.urdf_text)
    inertia = dict(zip(robot.link_names, parameters.inertial_parameters, strict=True))
    for element in root.findall('link'):
        for child in [c for c in element if c.tag in ('inertial', 'visual', 'collision')]:
            element.remove(child)
        name = element.get('name', '')
        if name in inertia:
            element.append(_inertial_element(inertia[name]))
    for joint in root.findall('joint'):
        for child in joint.findall('dynamics'):
            joint.remove(child)
    for other in [c for c in root if c.tag not in ('link', 'joint')]:
        root.remove(other)
    return ElementTree.tostring(root, encoding='unicode')


def _inertial_element(pi: Array) -> ElementTree.Element:
    element = ElementTree.Element('inertial')
    tensor = barycentric_inertia(pi)
    ElementTree.SubElement(element, 'origin', xyz=_text(pi[1:4] / pi[0]), rpy='0 0 0')
    ElementTree.SubElement(element, 'mass', value=_text(pi[:1]))
    rows, columns = np.triu_indices(3)
    entries = {
        f'i{"xyz"[row]}{"xyz"[column]}': _text([tensor[row, column]])
        for row, column in zip(rows, columns, strict=True)
    }
    ElementTree.SubElement(element, 'inertia', entries)
    return element


def _text(values: Sequence[float] | Array) -> str:
    return ' '.join(repr(float(value)) for value in values)
