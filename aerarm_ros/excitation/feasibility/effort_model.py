"""Torque and motor current a motion needs, by the model known before identification."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.friction import viscous_coulomb
from aerarm_ros.motion.float_array import FloatArray


class EffortModel:
    """Inverse dynamics with rotor inertia and friction, thesis (2.18), and the drive train.

    Parameters
    ----------
    robot : arm with its prior inertial parameters and friction.
    rotor_inertia : (n,) reflected to the joint [kg m^2], None for none.
    torque_per_ampere : (n,) joint torque per motor current [Nm/A]; None: current is unknown.
    load_friction : dry friction per torque that a gear passes on [-]; the robot's if None.
    """

    def __init__(
        self,
        robot: Robot,
        rotor_inertia: FloatArray | None = None,
        torque_per_ampere: FloatArray | None = None,
        load_friction: ArrayLike | None = None,
    ) -> None:
        self._n = robot.n
        self._dynamics = Dynamics(
            robot, np.zeros(robot.n) if rotor_inertia is None else rotor_inertia
        )
        self._viscous, self._coulomb = robot.viscous, robot.coulomb
        self._load_friction = np.asarray(
            robot.load_friction if load_friction is None else load_friction
        )
        self._torque_per_ampere = (
            np.full(robot.n, np.inf) if torque_per_ampere is None else torque_per_ampere
        )

    def carry(self, payload: ArrayLike) -> None:
        """Add a body to the last link, see `Dynamics.carry`."""
        self._dynamics.carry(payload)

    def effort(
        self, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """Return joint torques (M, n) [Nm] for (M, n) positions, velocities, accelerations."""
        inverse = self._dynamics.inverse
        rigid = np.array(
            [inverse(*sample) for sample in zip(position, velocity, acceleration, strict=True)]
        ).reshape(-1, self._n)
        # What turns the rotors does not go through the gears.
        load = rigid - self._dynamics.rotor_inertia * acceleration
        dry = self._coulomb + self._load_friction * np.abs(load)
        return rigid + viscous_coulomb(velocity, self._viscous, dry)

    def current(self, effort: FloatArray) -> FloatArray:
        """Return motor currents [A] for joint torques [Nm], thesis (4.2) and (4.7)."""
        return effort / self._torque_per_ampere

    def torque(self, current: FloatArray) -> FloatArray:
        """Return joint torques [Nm] of motor currents [A], without friction of the gears."""
        return current * self._torque_per_ampere
