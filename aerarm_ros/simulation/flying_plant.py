"""The simulated arm under a drone that flies."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import joined
from aerarm_ros.simulation.arm_plant import SUBSTEP, Array
from aerarm_ros.simulation.free_base_plant import BaseBody, FreeBasePlant, rotation_of
from aerarm_ros.simulation.plant_parameters import PlantParameters
from aerarm_ros.simulation.random_drift import RandomDrift
from aerarm_ros.simulation.rotors import Rotors

SPIN_UP = 0.3
"""[s] in which the rotors take over from whoever holds the drone."""

# A held drone is as heavy as that [kg], [kg m^2], and is put back in each sub-step.
_HELD = 1e6


class FlyingPlant(FreeBasePlant):
    """An `ArmPlant` under a drone: one mechanism on a free joint, pushed by rotors and gusts.

    There is no ground. Whoever carries the arm holds the drone as well, still and level where it
    is, until the arm's motors hold the arm and rotors have been commanded for 0.3 s; then nobody
    touches it any more. With rotors that stand it falls.

    Parameters
    ----------
    robot, parameters, position
        As for `FreeBasePlant`.
    drone
        As it truly is.
    rotor_timeout
        Silence of rotor commands after which the rotors stop [s].
    gust
        Force of the wind on the drone's centre of mass in the world [N], updated once a
        millisecond; none if not given.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: PlantParameters,
        position: ArrayLike,
        drone: DroneConfig,
        rotor_timeout: float = 0.2,
        gust: RandomDrift | None = None,
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
        super().__init__(robot, parameters, position, _body(robot, drone))
        data = self._data
        self._pose, self._twist, self._push = data.qpos[:7], data.qvel[:6], data.qfrc_applied[:6]
        self._hold(True)

    @property
    def odometry(self) -> tuple[Array, Array, Array, Array]:
        """Where the body is and how it moves.

        Position (3,) in the world [m]; attitude (x, y, z, w), body to world; velocity (3,) of the
        body frame's origin [m/s] and angular velocity (3,) [rad/s], both in body axes.
        """
        base = self.base
        velocity = rotation_of(base.quaternion).T @ base.velocity
        return base.position, np.roll(base.quaternion, -1), velocity, base.angular_velocity

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Put the arm somewhere, at rest unless a velocity is given, and hold the drone level."""
        self._place = self._data.qpos[:3].copy()
        self._turn = _heading(self._data.qpos[3:7])
        self._hold(True)
        super().reset(position, velocity)

    def restart(self, position: ArrayLike) -> None:
        """Put the arm somewhere, at rest, and the drone where it was at first."""
        self._data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        self.rotors.stop()
        super().restart(position)

    def let_go(self) -> None:
        """Leave the drone to its rotors and to gravity, from now on."""
        self._hold(False)

    def push(self, twist: ArrayLike) -> None:
        """Give a drone that was let go a velocity (6,): in the world [m/s], in the body [rad/s]."""
        self._twist[:] = twist

    def touch(self, force: ArrayLike, link: str = '') -> None:
        """Pull with a force (3,) in the world [N] from now on, none if it is zero.

        It acts at the origin of a link's frame, or at that of the drone's body if none is named.

        Raises
        ------
        ValueError
            If the arm has no such link.
        """
        force, (body, place) = np.array(force, dtype=float), self.place_on(link)
        if self._touched is not None:
            self._data.xfrc_applied[self._touched[0]] = 0.0
        self._touched = (body, place, force) if force.any() else None

    def place_on(self, link: str) -> tuple[int, Array]:
        """Return the engine's body that a link is part of, and its frame's place in that [m].

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
            self._pull(*self._touched)
        super().step()

    def true_parameters(self) -> dict[str, Any]:
        """Return what arm and drone are made of, in plain numbers for a YAML file."""
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
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = np.cross(lever, force)

    def _drive(self, wrench: Array) -> None:
        """Apply the rotors' wrench, given in body axes at the origin, and the wind."""
        rotation = rotation_of(self._pose[3:7])
        force = wrench[:3]
        if self._gust is None:
            self._push[3:] = wrench[3:]
        else:
            if self._count % 4 == 0:
                self._wind = self._gust.update()
            wind = rotation.T @ self._wind
            force = force + wind
            self._push[3:] = wrench[3:] + np.cross(self._centre, wind)
        self._push[:3] = rotation @ force


def _heading(quaternion: Array) -> Array:
    """Return the part of an attitude (w, x, y, z) that is a turn about the vertical."""
    w, _, _, z = quaternion
    length = np.hypot(w, z)
    if length < 1e-6:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.array([w / length, 0.0, 0.0, z / length])


def _body(robot: Robot, drone: DroneConfig) -> BaseBody:
    """Return the drone with the arm's base link, which is fixed to it."""
    mount, rotation = np.array(drone.mount.position), drone.mount.rotation
    link = robot.model.inertias[0]
    mass, centre, inertia = joined(
        (drone.mass, drone.centre_of_mass, drone.inertia_matrix),
        (link.mass, mount + rotation @ link.lever, rotation @ link.inertia @ rotation.T),
    )
    imu = drone.imu
    return BaseBody(mass, inertia, centre, mount, rotation, np.array(imu.position), imu.rotation)
