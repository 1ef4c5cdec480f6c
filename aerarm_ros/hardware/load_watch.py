"""Compares the torques of an arm held at rest with the loads of its model."""

from __future__ import annotations

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.boards.board_link import ArmMeasurements
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.motion.signals import Array

# A sample every so many cycles, so many samples in a mean, which is about a second.
_CYCLES = 20
_SAMPLES = 50
_MOVED = 0.01  # [rad] by which a joint at rest may creep in that time

# Friction may hold a load up or down: twice the configuration's, which commissioning accepts, and
# what a gear loses of the torque that passes it.
_FRICTION = 2.0
_GEAR_LOSS = 0.05
# How far an arm may be from its drawing: 25 % of mass and 10 % of extent, and material that lies
# elsewhere; with the torque constants' error.
_MODEL_ERROR = 0.35
_SHIFT = 0.025  # [m]

_DELIVERY_ERROR = 0.25
_CURRENT_ERROR = 0.05  # of the largest torque: offset and noise of the current's measurement


class LoadCheck:
    """Judges torques of an arm at rest.

    Parameters
    ----------
    config
        The arm: friction and rated payload.
    robot
        The arm as drawn.
    """

    def __init__(self, config: ArmConfig, robot: Robot) -> None:
        mass, *centre = config.rated_payload
        self._config = config
        # Not those of the gate: diagnostics may be made by another thread.
        self._empty, self._loaded = Dynamics(robot), Dynamics(robot)
        self._loaded.carry(point_mass(mass, centre))
        masses = np.array(robot.inertial_parameters)[:, 0]
        carried = np.cumsum(masses[::-1])[::-1]
        shifted = _SHIFT * float(np.linalg.norm(config.gravity_in_base)) * carried
        self._allowed: Array = _FRICTION * config.column('coulomb') + shifted
        self._current_error: Array = _CURRENT_ERROR * config.column('effort_max')

    def warnings(self, q: Array, held: Array, requested: Array) -> list[str]:
        """Return what is wrong with joints, and what to check.

        Parameters
        ----------
        q
            (n,) positions [rad].
        held, requested
            (n,) torques by the measured currents and by the boards' law [Nm]; NaN where not known.
        """
        empty, loaded = self._empty.gravity(q).copy(), self._loaded.gravity(q)
        lowest, highest = np.minimum(empty, loaded), np.maximum(empty, loaded)
        largest = np.maximum(np.abs(empty), np.abs(loaded))
        room = self._allowed + _MODEL_ERROR * np.abs(empty) + _GEAR_LOSS * largest
        differs = (held < lowest - room) | (held > highest + room)
        delivery_error = _DELIVERY_ERROR * np.abs(requested) + self._current_error
        fails = np.abs(requested - held) > delivery_error
        texts = []
        for i, name in enumerate(self._config.joint_names):
            if fails[i]:
                texts.append(
                    f'{name} was asked for {requested[i]:.2f} Nm, and its current makes '
                    f"{held[i]:.2f} Nm: check the driver of {name}, supply and motor phases ('arm "
                    "commission')"
                )
            elif differs[i]:
                texts.append(
                    f'{name} is held with {held[i]:.2f} Nm, but the model has a load of '
                    f'{empty[i]:.2f} Nm, {loaded[i]:.2f} Nm with the rated payload: check the '
                    f'payload, what touches or supports the arm, gravity_in_base, and gear ratio, '
                    f"sign, driver and torque constant of {name} ('arm commission')"
                )
        return texts


class LoadWatch:
    """Takes means of the torques while the arm is held, and warns where the check fails.

    The first second is left out: the arm may still be supported by hand. A cycle adds a sample at
    most; the model is asked when the warnings are.

    Parameters
    ----------
    config, robot
        The arm.
    references
        What the boards are asked for.
    """

    def __init__(self, config: ArmConfig, robot: Robot, references: MotorReferences) -> None:
        self._check = LoadCheck(config, robot)
        self._references = references
        self._means: Array | None = None
        self._judged: tuple[Array | None, list[str]] = None, []
        self._sums: Array = np.zeros((3, config.n))
        self._begin()

    def update(self, is_held: bool, state: ArmMeasurements) -> None:
        """Take a cycle's measurements; `is_held` while no command is followed."""
        if not is_held:
            if self._cycle:
                self._begin()
            return
        self._cycle += 1
        if self._cycle % _CYCLES == 0:
            self._add(state)

    def warnings(self) -> list[str]:
        """Return what is wrong in the posture that is held."""
        means = self._means
        if means is None:
            return []
        if self._judged[0] is not means:
            self._judged = means, self._check.warnings(*means)
        return self._judged[1]

    def _begin(self) -> None:
        self._cycle = 0
        self._means = None
        self._clear()
        self._count = -_SAMPLES

    def _clear(self) -> None:
        self._sums[:] = 0.0
        self._count = 0
        self._start: Array | None = None

    def _add(self, state: ArmMeasurements) -> None:
        if self._start is None:
            self._start = state.q.copy()
        elif np.abs(state.q - self._start).max() > _MOVED:
            self._begin()
            return
        self._count += 1
        if self._count <= 0:
            return
        motors = self._references.motors
        requested = self._references.torques(state.q, state.dq)
        # What the boards have integrated is an estimate of the bridge's own.
        requested[[motor.integral_gain > 0.0 for motor in motors]] = np.nan
        self._sums += (state.q, state.tau, requested)
        if self._count == _SAMPLES:
            self._means = self._sums / _SAMPLES
            self._clear()
