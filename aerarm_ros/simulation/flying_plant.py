"""Simulated arm under a body that follows a prescribed motion, or under a flying drone."""

from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import cross, joined
from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, PlantParameters, copy_settings
from aerarm_ros.simulation.base_profile import BaseProfile, BaseState
from aerarm_ros.simulation.sensors import BandLimitedNoise, RandomDrift
from aerarm_ros.simulation.wall import Wall


class Rotors:
    """Simulated rotors, whose thrusts follow commands with limits and a first-order lag.

    Without commands for `timeout` the motor controllers stop the rotors, which spin down, as on a
    real drone. The moment of a propeller's own acceleration and the effect of its motion through
    the air are neglected.

    Parameters
    ----------
    substep : float
        Time between two calls of `step` [s].
    timeout : float
        Time without commands after which the rotors are stopped [s].

    Attributes
    ----------
    thrust : (n,) ndarray
        Present thrusts of the rotors [N].
    """

    def __init__(self, drone: DroneConfig, substep: float, timeout: float) -> None:
        self._allocation = drone.allocation
        self._min, self._max = drone.column('thrust_min'), drone.column('thrust_max')
        self._gain = 1.0 - np.exp(-substep / drone.column('time_constant'))
        self._stopped = np.clip(0.0, self._min, self._max)
        self._substep = substep
        self._timeout = timeout
        self.stop()

    @property
    def is_commanded(self) -> bool:
        """Whether the last rotor command is younger than the time-out."""
        return self._silence <= self._timeout

    @property
    def time_commanded(self) -> float:
        """Time [s] for which rotor commands have arrived without interruption."""
        return self._commanded_for

    def command(self, thrust: ArrayLike) -> None:
        """Set the commanded thrusts (n,) [N], limited to the range of the rotors."""
        self._target = np.clip(np.asarray(thrust, dtype=float), self._min, self._max)
        self._silence = 0.0

    def stop(self) -> None:
        """Stop the rotors at once, and reset them to the state before the first command."""
        self.thrust = self._stopped.copy()
        self._target = self._stopped
        self._silence = np.inf
        self._commanded_for = 0.0

    def step(self) -> Array:
        """Advance by a sub-step; return the rotors' wrench (6,) at the body frame's origin."""
        self._silence += self._substep
        if self._silence > self._timeout:
            self._target = self._stopped
            self._commanded_for = 0.0
        else:
            self._commanded_for += self._substep
        self.thrust += self._gain * (self._target - self.thrust)
        wrench: Array = self._allocation @ self.thrust
        return wrench


GRAVITY = np.array([0.0, 0.0, -9.81])
"""Gravity vector in world axes [m/s^2]."""

_FREE = 6


@dataclass(frozen=True, eq=False)
class BaseBody:
    """Mass properties of the body that carries the arm, and poses of arm and IMU on this body.

    Attributes
    ----------
    mass : float
        Mass of the body [kg].
    inertia : (3, 3) ndarray
        Inertia about the centre of mass, in body axes [kg m^2].
    centre : (3,) ndarray
        Centre of mass in the body frame [m].
    mount, mount_rotation : (3,) and (3, 3) ndarray
        Pose of the arm's base frame in the body frame.
    imu, imu_rotation : (3,) and (3, 3) ndarray
        Pose of the IMU's frame in the body frame.
    """

    mass: float
    inertia: Array
    centre: Array = field(default_factory=lambda: np.zeros(3))
    mount: Array = field(default_factory=lambda: np.zeros(3))
    mount_rotation: Array = field(default_factory=lambda: np.eye(3))
    imu: Array = field(default_factory=lambda: np.zeros(3))
    imu_rotation: Array = field(default_factory=lambda: np.eye(3))


class FreeBasePlant(ArmPlant):
    """Simulated arm (`ArmPlant`) on a free body; the physics engine simulates both.

    The engine computes the interaction of arm and body. The parameters are those of the arm on a
    fixed base. The robot's own gravity is not used.

    Parameters
    ----------
    robot, parameters, position
        As for `ArmPlant`.
    body
        The body that carries the arm.
    """

    def __init__(
        self, robot: Robot, parameters: PlantParameters, position: ArrayLike, body: BaseBody
    ) -> None:
        self._body = body
        super().__init__(robot, parameters, position)

    @property
    def base(self) -> BaseState:
        """Pose, velocity and acceleration of the body that carries the arm."""
        data = self._data
        return BaseState(
            np.array(data.qpos[:3]),
            np.array(data.qpos[3:7]),
            np.array(data.qvel[:3]),
            np.array(data.qvel[3:6]),
            np.array(data.qacc[:3]),
            np.array(data.qacc[3:6]),
        )

    @property
    def imu(self) -> tuple[Array, Array, Array]:
        """Readings of an ideal IMU on the body: attitude, angular velocity, specific force.

        Attitude (x, y, z, w), IMU to world; angular velocity [rad/s]; specific force [m/s^2], both
        (3,) in the IMU's axes.
        """
        base, body = self.base, self._body
        to_world = rotation_of(base.quaternion)
        spin, rate = base.angular_acceleration, base.angular_velocity
        lever = cross(spin, body.imu) + cross(rate, cross(rate, body.imu))
        force = to_world.T @ (base.acceleration - GRAVITY) + lever
        attitude = np.empty(4)
        mujoco.mju_mat2Quat(attitude, (to_world @ body.imu_rotation).ravel())
        to_imu = body.imu_rotation.T
        return np.roll(attitude, -1), to_imu @ rate, to_imu @ force

    def _engine_model(self, robot: Robot) -> Any:
        return _with_free_base(robot, super()._engine_model(robot), self._body)

    def _body_name(self, link: str) -> str:
        return f'arm_{link}'

    def _set_gravity(self) -> None:
        # A support of the arm's weight acts in the world frame.
        self._model.opt.gravity = (1.0 - self._support) * GRAVITY


def rotation_of(quaternion: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)


def _with_free_base(robot: Robot, fixed: Any, base: BaseBody) -> Any:
    """Return the physics engine's model of the arm on a free body, with the settings of `fixed`."""
    spec = mujoco.MjSpec()
    tensor = base.inertia
    body = spec.worldbody.add_body(
        name='base',
        mass=base.mass,
        ipos=base.centre,
        fullinertia=[*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]],
        explicitinertial=True,
    )
    body.add_freejoint()
    arm = mujoco.MjSpec.from_string(_without_shapes(robot.urdf_text))
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, np.ascontiguousarray(base.mount_rotation).ravel())
    frame = body.add_frame(pos=base.mount, quat=turn)
    frame.attach_body(arm.worldbody.first_body(), 'arm_', '')
    model = spec.compile()
    copy_settings(fixed, model, slice(_FREE, None), slice(1, None))
    for body_index in range(1, fixed.nbody):
        old = fixed.body(body_index)
        new = model.body(f'arm_{old.name}')
        for what in ('mass', 'ipos', 'iquat', 'inertia'):
            getattr(new, what)[:] = getattr(old, what)
    return model


def _without_shapes(urdf: str) -> str:
    root = ElementTree.fromstring(urdf)
    for link in root.findall('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    return ElementTree.tostring(root, encoding='unicode')


# The base is so heavy [kg], [kg m^2] that the arm's reaction changes its acceleration by 1e-5
# m/s^2 at most; position and velocity are set in each sub-step.
_INERTIA = 1e6


class MovingBasePlant(FreeBasePlant):
    """Simulated arm on a base that follows a motion profile (`BaseProfile`) exactly.

    Parameters
    ----------
    robot, parameters, position
        As for `FreeBasePlant`.
    profile
        Motion of the base, which begins with the call of `start`.
    """

    def __init__(
        self, robot: Robot, parameters: PlantParameters, position: ArrayLike, profile: BaseProfile
    ) -> None:
        self._profile = profile
        self._start_count: int | None = None
        super().__init__(robot, parameters, position, BaseBody(_INERTIA, _INERTIA * np.eye(3)))

    @property
    def base(self) -> BaseState:
        """Pose, velocity and acceleration of the base, as the profile prescribes them."""
        begun = self._start_count
        return self._profile.evaluate(-1.0 if begun is None else (self._count - begun) * SUBSTEP)

    def start(self) -> None:
        """Start the base's motion."""
        self._start_count = self._count

    def step(self) -> None:
        """Advance by one sub-step."""
        self._place_base()
        super().step()

    def _place_base(self) -> None:
        base, data = self.base, self._data
        data.qpos[:3], data.qpos[3:7] = base.position, base.quaternion
        data.qvel[:3], data.qvel[3:6] = base.velocity, base.angular_velocity
        gravity = (1.0 - self._support) * GRAVITY
        data.qfrc_applied[:3] = _INERTIA * (base.acceleration - gravity)
        data.qfrc_applied[3:6] = _INERTIA * base.angular_acceleration


SPIN_UP = 0.3
"""Duration [s] of rotor commands after which the simulation releases the held drone."""

# [kg], [kg m^2] of a held drone, which is put back in each sub-step.
_HELD = 1e6


class FlyingPlant(FreeBasePlant):
    """Simulated arm under a drone that is moved by rotors and gusts of wind.

    The simulation has no ground. At first, the simulation holds the drone still and level. The
    drone is released once the motors hold the arm and the rotors have been commanded for 0.3 s.
    Without commands it then falls.

    Parameters
    ----------
    robot, parameters, position
        As for `FreeBasePlant`.
    drone
        True parameters of the drone.
    rotor_timeout
        Time without rotor commands after which the rotors stop [s].
    gust
        Force of the wind on the drone's centre of mass in the world [N], updated once per
        millisecond; none by default.

    Attributes
    ----------
    wall
        Wall that the arm can touch, None without one.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: PlantParameters,
        position: ArrayLike,
        drone: DroneConfig,
        rotor_timeout: float = 0.2,
        gust: RandomDrift | BandLimitedNoise | None = None,
    ) -> None:
        self.drone = drone
        self.rotors = Rotors(drone, SUBSTEP, rotor_timeout)
        self.is_held = True
        self._gust = gust
        self._wind = np.zeros(3)
        self._centre = np.array(drone.centre_of_mass)
        self._place = np.zeros(3)
        self._turn = np.array([1.0, 0.0, 0.0, 0.0])
        self._robot = robot
        self._touched: tuple[int, Array, Array] | None = None
        self.wall: Wall | None = None
        self._leaning = 0, np.zeros(3)
        super().__init__(robot, parameters, position, _body(robot, drone))
        data = self._data
        self._pose, self._twist, self._push = data.qpos[:7], data.qvel[:6], data.qfrc_applied[:6]
        self._hold(True)

    @property
    def odometry(self) -> tuple[Array, Array, Array, Array]:
        """Position, attitude, velocity and angular velocity of the drone's body.

        The position (3,) [m] is in the world, the attitude (x, y, z, w) rotates from body to world.
        The velocity (3,) of the body frame's origin [m/s] and the angular velocity (3,) [rad/s] are
        in body axes.
        """
        base = self.base
        velocity = rotation_of(base.quaternion).T @ base.velocity
        return base.position, np.roll(base.quaternion, -1), velocity, base.angular_velocity

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set joint angles and velocities (default zero), and hold the drone level."""
        self._place = self._data.qpos[:3].copy()
        self._turn = _heading(self._data.qpos[3:7])
        self._hold(True)
        super().reset(position, velocity)

    def restart(self, position: ArrayLike) -> None:
        """Restart with resting joints at these angles (n,) [rad], and the initial drone pose."""
        self._data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        self.rotors.stop()
        super().restart(position)

    def let_go(self) -> None:
        """Release the held drone, so that it moves under its rotors and gravity."""
        self._hold(False)

    def push(self, twist: ArrayLike) -> None:
        """Set the drone's velocity (6,): linear in world axes, angular in body axes."""
        self._twist[:] = twist

    def touch(self, force: ArrayLike, link: str = '') -> None:
        """Apply a constant force (3,) [N] in world axes from now on; zero removes it.

        The force acts at the origin of a link's frame, or of the drone's body frame without a
        link.

        Raises
        ------
        ValueError
            If the arm has no such link.
        """
        force, (body, place) = np.array(force, dtype=float), self.place_on(link)
        if self._touched is not None:
            self._data.xfrc_applied[self._touched[0]] = 0.0
        self._touched = (body, place, force) if force.any() else None

    def build(self, wall: Wall, link: str) -> None:
        """Add a wall that the origin of a link's frame can touch.

        Raises
        ------
        ValueError
            If the arm has no such link.
        """
        self.wall, self._leaning = wall, self.place_on(link)

    def place_on(self, link: str) -> tuple[int, Array]:
        """Return the engine's body number of a link, and the link frame's position in that body.

        Raises
        ------
        ValueError
            If the arm has no such link; the drone's body has no name.
        """
        body = self._model.body('base').id
        if not link:
            return body, np.zeros(3)
        frame = self._robot.frame_of(link)
        place = np.array(frame.placement.translation)
        if frame.parentJoint == 0:  # fixed to the drone
            return body, self._body.mount + self._body.mount_rotation @ place
        return int(self._model.jnt_bodyid[frame.parentJoint]), place

    def step(self) -> None:
        """Advance by one sub-step."""
        wrench = self.rotors.step()
        if self.is_held:
            if self._support == 0.0 and self.rotors.time_commanded > SPIN_UP:
                self._hold(False)
            else:
                self._place_base()
        if not self.is_held:
            self._drive(wrench)
        if self._touched is not None:
            self._data.xfrc_applied[self._touched[0]] = 0.0
            self._pull(*self._touched)
        if self.wall is not None:
            self._lean(self.wall, *self._leaning)
        super().step()

    def true_parameters(self) -> dict[str, Any]:
        """Return the true parameters of arm and drone for a YAML file."""
        drone = self.drone
        made = {'name': drone.name, 'mass': drone.mass, 'inertia': list(drone.inertia)}
        return {**super().true_parameters(), 'drone': made}

    def _hold(self, is_held: bool) -> None:
        self.is_held = is_held
        self._model.dof_armature[:6] = _HELD if is_held else 0.0

    def _place_base(self) -> None:
        data = self._data
        data.qpos[:3], data.qpos[3:7] = self._place, self._turn
        data.qvel[:6] = data.qfrc_applied[:6] = 0.0

    def _pull(self, body: int, place: Array, force: Array) -> None:
        data = self._data
        lever = data.xpos[body] - data.xipos[body] + data.xmat[body].reshape(3, 3) @ place
        data.xfrc_applied[body, :3] += force
        data.xfrc_applied[body, 3:] += cross(lever, force)

    def _lean(self, wall: Wall, body: int, place: Array) -> None:
        data = self._data
        if self._touched is None or self._touched[0] != body:
            data.xfrc_applied[body] = 0.0
        at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ place
        self._pull(body, place, wall.update(at, SUBSTEP))

    def _drive(self, wrench: Array) -> None:
        """Apply the rotors' wrench (6,), given in body axes, and the wind's force to the drone."""
        rotation = rotation_of(self._pose[3:7])
        force = wrench[:3]
        if self._gust is None:
            self._push[3:] = wrench[3:]
        else:
            if self._count % 4 == 0:
                self._wind = self._gust.update()
            wind = rotation.T @ self._wind
            force = force + wind
            self._push[3:] = wrench[3:] + cross(self._centre, wind)
        self._push[:3] = rotation @ force


def _heading(quaternion: Array) -> Array:
    """Return an attitude (w, x, y, z) reduced to its heading, a rotation about the vertical."""
    w, _, _, z = quaternion
    length = np.hypot(w, z)
    if length < 1e-6:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.array([w / length, 0.0, 0.0, z / length])


def _body(robot: Robot, drone: DroneConfig) -> BaseBody:
    """Return the rigid body that consists of the drone and the arm's base link."""
    mount, rotation = np.array(drone.mount.position), drone.mount.rotation
    link = robot.model.inertias[0]
    mass, centre, inertia = joined(
        (drone.mass, drone.centre_of_mass, drone.inertia_matrix),
        (link.mass, mount + rotation @ link.lever, rotation @ link.inertia @ rotation.T),
    )
    imu = drone.imu
    return BaseBody(mass, inertia, centre, mount, rotation, np.array(imu.position), imu.rotation)
