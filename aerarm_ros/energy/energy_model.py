"""What a motion costs, by the model of an arm."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.compensation.friction_compensation import FrictionCompensation
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.energy.drive_power import DrivePower
from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_motion import JointMotion

_STEP = 2e-3  # [s]


class EnergyModel:
    """Torque, power and energy of an arm's drives: model, friction, drive train, power stage.

    Parameters
    ----------
    config : ArmConfig
        Drive train, resistances and power stage.
    robot : Robot
        Links, and friction f_v, f_s.
    rotor_inertia : (n,) array_like, optional
        At the joints [kg m^2]; from the configuration if not given.
    load_friction : float or (n,) array_like, optional
        Dry friction per torque that a gear passes on [-]; the robot's if not given.
    friction_width : float
        Velocity at which three quarters of the dry friction are felt [rad/s].

    Attributes
    ----------
    drives, dynamics, friction
        `DrivePower`, `Dynamics` and `FrictionCompensation` behind it.
    load_friction
        As given.

    Raises
    ------
    ValueError
        If a coefficient is negative.
    """

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot,
        rotor_inertia: npt.ArrayLike | None = None,
        load_friction: npt.ArrayLike | None = None,
        friction_width: float = 0.02,
    ) -> None:
        self.n = robot.n
        self.config = config
        self.drives = DrivePower(config)
        inertia = config.column('reflected_inertia') if rotor_inertia is None else rotor_inertia
        self.dynamics = Dynamics(robot, inertia)
        self.load_friction = robot.load_friction if load_friction is None else load_friction
        self._dry_and_viscous = robot.viscous, robot.coulomb
        self.friction = self.friction_of_width(friction_width)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the last link, see `Dynamics.carry`."""
        self.dynamics.carry(payload)

    def friction_of_width(self, width: float) -> FrictionCompensation:
        """Return the same friction, spread over other velocities about rest [rad/s]."""
        return FrictionCompensation(*self._dry_and_viscous, width, load_share=self.load_friction)

    def friction_torque(self, dq: FloatArray, ddq: FloatArray, rigid: FloatArray) -> FloatArray:
        """Return the friction (..., n) [Nm] of a motion.

        Gears pass on what the links take: what turns the rotors does not go through them.

        Parameters
        ----------
        dq, ddq : (..., n) ndarray
            [rad/s], [rad/s^2]
        rigid : (..., n) ndarray
            Inverse dynamics, rotors included [Nm].
        """
        return self.friction.torque(dq, rigid - self.dynamics.rotor_inertia * ddq)

    def power(self, motion: JointMotion, times: FloatArray) -> FloatArray:
        """Return the electrical power of each motor (M, n) [W] at times (M,) [s]."""
        q, dq, ddq = motion.evaluate(times)
        rigid = np.array([self.dynamics.inverse(*row) for row in zip(q, dq, ddq, strict=True)])
        return self.drives.electrical(rigid + self.friction_torque(dq, ddq, rigid), dq)

    def balance(self, motion: JointMotion) -> EnergyBalance:
        """Return what a motion will take, from its begin to its end."""
        steps = max(1, round(motion.duration / _STEP))
        dt = motion.duration / steps
        q, dq, ddq = motion.evaluate((np.arange(steps) + 0.5) * dt)
        rigid, weight = self.torques(q, dq, ddq)
        friction = self.friction_torque(dq, ddq, rigid)
        tau = rigid + friction
        return self.split(dt, dq, tau, rigid - weight, weight, friction)

    def split(
        self,
        dt: float,
        dq: FloatArray,
        tau: FloatArray,
        inertia: FloatArray,
        weight: FloatArray,
        friction: FloatArray,
    ) -> EnergyBalance:
        """Return the balance of M intervals.

        Parameters
        ----------
        dt : float
            Length of each [s].
        dq, tau : (M, n) ndarray
            Velocities [rad/s] and torques of the drives [Nm] in their middles.
        inertia, weight, friction : (M, n) ndarray
            Parts of the torque that the model knows [Nm].
        """
        electrical = self.drives.electrical(tau, dq)
        braking = np.maximum(-electrical, 0.0)
        gear = (self.drives.shaft - 1.0) * tau * dq
        recovery, stage = self.drives.recovery, self.config.power_stage

        def joules(power: FloatArray) -> FloatArray:
            total: FloatArray = dt * power.sum(axis=0)
            return total

        seconds = dt * len(dq)
        return EnergyBalance(
            seconds,
            copper=joules(self.drives.copper(tau)),
            friction=joules(friction * dq + gear),
            gravity=joules(weight * dq),
            inertia=joules(inertia * dq),
            unexplained=joules((tau - inertia - weight - friction) * dq),
            burnt=(1.0 - recovery) * joules(braking),
            standby=np.full(self.n, stage.standby * seconds / self.n),
            recovered=recovery * joules(braking),
        )

    def torques(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return inverse dynamics and gravity, (M, n) [Nm] each."""

        def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
            for motion in zip(q, dq, ddq, strict=True):
                yield self.dynamics.inverse(*motion), self.dynamics.gravity(motion[0])

        rigid, weight = zip(*rows(), strict=True)
        return np.array(rigid), np.array(weight)
