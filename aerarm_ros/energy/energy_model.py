"""What a motion costs, by the model of an arm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.signals import Array, JointMotion


class DrivePower:
    """Electrical power of n drives by the torque and velocity of their joints, thesis (4.1).

    With a quadrature current alone a motor takes ``3/2 R i^2 + K_i i omega_m``: copper loss and
    the power of its shaft, of which a gear with an efficiency below one passes on a part. While
    that sum is negative the motor brakes; of this the power stage lets the supply take back a
    share, and burns the rest.

    Arguments are (..., n) arrays: torques of the drives at the joints [Nm], as in `joint_states`,
    and velocities [rad/s].

    Parameters
    ----------
    config : ArmConfig

    Attributes
    ----------
    copper_per_torque2 : (n,) ndarray
        Copper loss over the torque squared [W/Nm^2].
    shaft : (n,) ndarray
        Power of the shaft over that of the joint, 1 / eta [-].
    recovery : float
        Share of the braking power that the supply takes back.
    """

    def __init__(self, config: ArmConfig) -> None:
        per_ampere = config.column('torque_per_ampere')
        self.copper_per_torque2 = 1.5 * config.column('motor.resistance') / per_ampere**2
        self.shaft = 1.0 / config.column('gear.efficiency')
        self.recovery = config.power_stage.recovery

    def copper(self, tau: Array) -> Array:
        """Return the copper loss [W]."""
        loss: Array = self.copper_per_torque2 * tau**2
        return loss

    def electrical(self, tau: Array, dq: Array) -> Array:
        """Return the power into the motors [W], negative where they brake."""
        power: Array = self.copper(tau) + self.shaft * tau * dq
        return power

    def from_supply(self, electrical: npt.ArrayLike) -> Array:
        """Return the supply's output for electrical powers [W], negative for recuperation."""
        power = np.asarray(electrical, dtype=float)
        return np.where(power < 0.0, self.recovery * power, power)


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Where the energy of n joints went, in some time.

    All but `seconds` are (n,) [J] and add up: what the supply gave is the sum of `parts`.

    Attributes
    ----------
    seconds : float
        [s]
    copper : heat of the windings.
    friction : heat of joints and gears, by the friction model.
    gravity : work against the weight of links and payload, negative where they sank.
    inertia : work into the motion, Coriolis and centrifugal torques included; zero in sum over the
        joints from rest to rest.
    unexplained : work of the drives that the model does not know; zero for a planned motion.
    burnt : braking energy that the power stage burns.
    standby : of the boards, a joint's share.
    recovered : braking energy that the supply took back; part of none of the others.
    """

    seconds: float
    copper: Array
    friction: Array
    gravity: Array
    inertia: Array
    unexplained: Array
    burnt: Array
    standby: Array
    recovered: Array

    PARTS = ('copper', 'friction', 'gravity', 'inertia', 'unexplained', 'burnt', 'standby')

    @classmethod
    def nothing(cls, n: int) -> EnergyBalance:
        """Return the balance of no time."""
        return cls(0.0, *(np.zeros(n) for _ in fields(cls)[1:]))

    def __add__(self, other: EnergyBalance) -> EnergyBalance:
        """Return the balance of both times together."""
        values = (getattr(self, f.name) + getattr(other, f.name) for f in fields(self))
        return EnergyBalance(*values)

    @cached_property
    def parts(self) -> Array:
        """(7, n) parts of the supplied energy [J], rows as named by `PARTS`."""
        return np.array([getattr(self, name) for name in self.PARTS])

    @property
    def motors(self) -> Array:
        """(n,) energy supplied to each motor [J]: all parts but standby."""
        return self.supplied - self.standby

    @property
    def supplied(self) -> Array:
        """(n,) supplied minus recuperated energy [J]."""
        total: Array = self.parts.sum(axis=0)
        return total

    def as_text(self, joint_names: tuple[str, ...]) -> str:
        """Return a table of joules: a line a joint, and their sum."""
        heads = [*self.PARTS, 'supplied', 'recovered']
        columns = np.vstack([self.parts, self.supplied, self.recovered])
        table = np.column_stack([columns, columns.sum(axis=1)])
        width = max(map(len, (*joint_names, 'all')))
        lines = [' ' * width + ''.join(f'{head:>12}' for head in heads) + '   [J]']
        for name, column in zip((*joint_names, 'all'), table.T, strict=True):
            lines.append(f'{name:{width}}' + ''.join(f'{value:12.3f}' for value in column))
        return '\n'.join(lines)


_STEP = 2e-3  # [s]


class EnergyModel:
    """Torque, power and energy of an arm's drives: model, friction, drive train, power stage.

    Parameters
    ----------
    config : ArmConfig
        Drive train, resistances and power stage.
    robot : Robot
        Links, and friction f_v, f_s; that of the configuration for joints of which the URDF
        states none.
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
        unstated = (robot.viscous == 0.0) & (robot.coulomb == 0.0)
        self._viscous = np.where(unstated, config.column('viscous'), robot.viscous)
        self._coulomb = np.where(unstated, config.column('coulomb'), robot.coulomb)
        self.friction = self.friction_of_width(friction_width)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the last link, see `Dynamics.carry`."""
        self.dynamics.carry(payload)

    def friction_of_width(self, width: float) -> FrictionCompensation:
        """Return the same friction, spread over other velocities about rest [rad/s]."""
        share = self.load_friction
        return FrictionCompensation(self._viscous, self._coulomb, width, load_share=share)

    def friction_torque(self, dq: Array, ddq: Array, rigid: Array) -> Array:
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

    def power(self, motion: JointMotion, times: Array) -> Array:
        """Return the electrical power of each motor (M, n) [W] at times (M,) [s]."""
        q, dq, ddq = motion.evaluate(times)
        rigid = np.array([self.dynamics.inverse(*row) for row in zip(q, dq, ddq, strict=True)])
        return self.drives.electrical(rigid + self.friction_torque(dq, ddq, rigid), dq)

    def balance(self, motion: JointMotion) -> EnergyBalance:
        """Return the predicted energy balance of a motion."""
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
        dq: Array,
        tau: Array,
        inertia: Array,
        weight: Array,
        friction: Array,
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

        def joules(power: Array) -> Array:
            total: Array = dt * power.sum(axis=0)
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

    def torques(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """Return inverse dynamics and gravity, (M, n) [Nm] each."""

        def rows() -> Iterator[tuple[Array, Array]]:
            for motion in zip(q, dq, ddq, strict=True):
                yield self.dynamics.inverse(*motion), self.dynamics.gravity(motion[0])

        rigid, weight = zip(*rows(), strict=True)
        return np.array(rigid), np.array(weight)


class HoldingLoss:
    """Copper loss of the torques that hold the arm's weight, thesis (4.1) at rest.

    Parameters
    ----------
    model : EnergyModel
    """

    def __init__(self, model: EnergyModel) -> None:
        self._dynamics = model.dynamics
        self._drives = model.drives
        self._rest = np.zeros(model.n)

    def watts(self, q: Array) -> float:
        """Return the loss at q (n,) [rad] in watts."""
        return float(self._drives.copper(self._dynamics.gravity(q)).sum())

    def gradient(self, q: Array) -> Array:
        """Return its derivative by q, (n,) [W/rad]."""
        rest = self._rest
        weight, slopes, _, _ = self._dynamics.inverse_with_slopes(q, rest, rest)
        gradient: Array = 2.0 * (self._drives.copper_per_torque2 * weight) @ slopes
        return gradient
