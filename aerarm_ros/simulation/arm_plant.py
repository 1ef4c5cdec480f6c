"""The arm as a physics engine sees it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import barycentric_inertia
from aerarm_ros.simulation.plant_parameters import PlantParameters

Array = NDArray[np.float64]

SUBSTEP = 0.25e-3  # [s] four in a cycle of 1 ms
_STOP_MARGIN = 0.1  # [rad] the mechanical stop lies beyond the limit that software keeps
# MuJoCo's constraints are soft. These are as stiff as the sub-step allows, so that a joint held
# by dry friction creeps by less than 1e-6 rad/s.
_FRICTION_SOLREF = (2.0 * SUBSTEP, 1.0)
_FRICTION_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
_STOP_SOLREF = (20.0 * SUBSTEP, 1.0)


class PlantError(ValueError):
    """The physics engine cannot simulate this arm; the text says what to check."""


class ArmPlant:
    """A simulated arm with rotor inertia, and viscous, Coulomb and load-dependent friction.

    The engine is MuJoCo, built from the URDF's kinematics and the given parameters; nothing
    is computed by the controllers' model. Equation of motion, thesis (2.7) with rotors::

        (B(q) + J_a) ddq + C(q, dq) dq + g(q) + f_v dq + friction = tau

    The dry friction of joint i is at most ``f_s + c |tau_t|`` with the torque ``tau_t`` that
    its gear transmitted in the sub-step before. It is a constraint of the engine, not a
    function of speed: a joint rests for as long as its load is smaller.

    Parameters
    ----------
    robot
        Gives kinematics, joint limits (the stops lie a little beyond) and gravity.
    parameters
        True parameters of the arm.
    position
        Initial joint angles (n,) [rad]; zero if not given.

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
        # The engine's own arrays: written and read in place in every sub-step. A base comes first.
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
        """Joint angles (n,) [rad], a copy."""
        return np.array(self._angle)

    @property
    def velocity(self) -> Array:
        """Joint velocities (n,) [rad/s], a copy."""
        return np.array(self._velocity)

    @property
    def acceleration(self) -> Array:
        """Joint accelerations (n,) of the last sub-step [rad/s^2], a copy."""
        return np.array(self._acceleration)

    @property
    def transmitted_effort(self) -> Array:
        """Torque (n,) that the gears passed to the links in the last sub-step [Nm], a copy."""
        return self._load.copy()

    @property
    def energy(self) -> float:
        """Potential and kinetic energy, rotors included [J]."""
        mujoco.mj_forward(self._model, self._data)
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(np.sum(self._data.energy))

    @property
    def gravity_in_base(self) -> Array:
        """Gravity in the base frame (3,) [m/s^2]."""
        return self._gravity.copy()

    @gravity_in_base.setter
    def gravity_in_base(self, gravity: ArrayLike) -> None:
        self._gravity = np.array(gravity, dtype=float)
        self._set_gravity()

    @property
    def support(self) -> float:
        """Share of the arm's weight that somebody carries, 0 to 1."""
        return self._support

    @support.setter
    def support(self, share: float) -> None:
        self._support = min(max(share, 0.0), 1.0)
        self._set_gravity()

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Put the arm somewhere, at rest unless a velocity (n,) [rad/s] is given."""
        mujoco.mj_resetData(self._model, self._data)
        self._angle[:] = position
        self._velocity[:] = 0.0 if velocity is None else velocity
        self._effort[:] = 0.0
        self._place_base()
        mujoco.mj_forward(self._model, self._data)
        self._set_friction()

    def restart(self, position: ArrayLike) -> None:
        """Put the arm somewhere, at rest, and what carries it where it was at first."""
        self.reset(position)

    def apply_effort(self, effort: ArrayLike) -> None:
        """Set the torques (n,) that the motors put into the gears, at joint side [Nm]."""
        self._effort[:] = effort

    def scale_friction(self, factors: Sequence[float]) -> None:
        """Multiply the dry friction of each joint's gear by a factor of n, from now on."""
        for row, coulomb, factor in zip(
            self._constants, self.parameters.coulomb.tolist(), factors, strict=True
        ):
            row[2] = factor * coulomb

    def grasp(self, parameters: PlantParameters) -> None:
        """Let the last link be that of other parameters, as of an arm that picks something up.

        The motion goes on: what is grasped moved with the arm already.

        Parameters
        ----------
        parameters
            Of which the last link's inertial ones count.
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
        # What is derived of them; on other data, as it puts the joints to zero.
        mujoco.mj_setConst(model, mujoco.MjData(model))
        inertial = np.array(self.parameters.inertial_parameters)
        inertial[-1] = pi
        self.parameters = replace(self.parameters, inertial_parameters=inertial)

    def step(self) -> None:
        """Advance by one sub-step."""
        self._applied[:] = self._effort
        mujoco.mj_step(self._model, self._data)
        self._count += 1
        self._set_friction()

    def advance(self, seconds: float) -> None:
        """Advance by a time, rounded to whole sub-steps, under constant effort."""
        for _ in range(round(seconds / SUBSTEP)):
            self.step()

    def true_parameters(self) -> dict[str, Any]:
        """Return what the arm is made of, in plain numbers for a YAML file."""
        return {**self.parameters.as_dict(), 'gravity_in_base': self._gravity.tolist()}

    # What a plant on a base of its own changes.

    def _engine_model(self, robot: Robot) -> Any:
        return _fixed_base_model(robot, self.parameters)

    def _last_link(self) -> int:
        """Return the engine's number of the last link."""
        return int(self._model.jnt_bodyid[-1])

    def _set_gravity(self) -> None:
        """Let the engine's gravity be what nobody carries."""
        self._model.opt.gravity = (1.0 - self._support) * self._gravity

    def _place_base(self) -> None:
        """Put the base where it is told to be, after the engine's data were reset."""

    def _set_friction(self) -> None:
        """Let the gears' dry friction follow the torque that they transmit."""
        # Plain numbers: for some joints that is faster than a dozen operations on arrays.
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
            limit.append(coulomb + share * abs(transmitted))
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
            f'the physics engine moves joints {names}, the arm {list(robot.joint_names)}: '
            'locked joints cannot be simulated'
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


def bare_urdf(robot: Robot, parameters: PlantParameters) -> str:
    """Return the URDF with kinematics as they are, the given inertia, and nothing else.

    Shapes go because there are no contacts, friction because the plant has its own, and the
    inertia of fixed links because `parameters` has it in the links that carry them.
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
