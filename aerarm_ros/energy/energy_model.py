"""Electrical energy of an arm's motion, predicted by a model of links and drives."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.signals import ArmState, Array, JointMotion


class DrivePower:
    """Electrical power of n drives as a function of joint torque and velocity, thesis (4.1).

    With a quadrature current only, a motor consumes ``3/2 R i^2 + K_i i omega_m``, the sum of
    copper loss and shaft power. A gear with an efficiency below one transmits only a fraction of
    the shaft power. While the sum is negative, the motor brakes and returns power: the supply
    absorbs the fraction `recovery` of it, and the power stage dissipates the rest.

    Arguments are (..., n) arrays: drive torques at the joints [Nm], as in `joint_states`, and joint
    velocities [rad/s].

    Attributes
    ----------
    copper_per_torque2 : (n,) ndarray
        Copper loss per squared torque [W/Nm^2].
    shaft : (n,) ndarray
        Ratio of shaft power to joint power, 1 / eta [-].
    recovery : float
        Fraction of the braking power that the supply absorbs.
    """

    def __init__(self, config: ArmConfig) -> None:
        per_ampere = config.column('torque_per_ampere')
        self.copper_per_torque2 = 1.5 * config.column('motor.resistance') / per_ampere**2
        self.shaft = 1.0 / config.column('gear.efficiency')
        self.recovery = config.power_stage.recovery

    def copper(self, tau: Array) -> Array:
        """Return the copper loss of each motor [W] at joint torques `tau` [Nm]."""
        loss: Array = self.copper_per_torque2 * tau**2
        return loss

    def electrical(self, tau: Array, dq: Array) -> Array:
        """Return the electrical power into each motor [W], negative while the motor brakes."""
        power: Array = self.copper(tau) + self.shaft * tau * dq
        return power

    def from_supply(self, electrical: npt.ArrayLike) -> Array:
        """Return the power drawn from the supply [W], given the electrical motor powers [W]."""
        power = np.asarray(electrical, dtype=float)
        return np.where(power < 0.0, self.recovery * power, power)


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energy of n joints in a time interval, divided by cause.

    All attributes except `seconds` are (n,) [J]; the supplied energy is the sum of `parts`.

    Attributes
    ----------
    seconds : float
        Duration of the interval [s].
    copper : heat of the windings.
    friction : heat of joints and gears, by the friction model.
    gravity : work against the weight of links and payload, negative for downward motion.
    inertia : work into kinetic energy, including Coriolis and centrifugal torques; for a motion
        from rest to rest its sum over the joints is zero.
    unexplained : measured work of the drives minus the modelled work; zero for a planned motion.
    burnt : braking energy that the power stage dissipates.
    standby : standby energy of the boards, divided among the joints.
    recovered : braking energy that the supply absorbed; not included in any other part.
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
        """Return an energy balance of n joints with zero energy."""
        return cls(0.0, *(np.zeros(n) for _ in fields(cls)[1:]))

    def __add__(self, other: EnergyBalance) -> EnergyBalance:
        """Return the sum of the energy balances of two time intervals."""
        values = (getattr(self, f.name) + getattr(other, f.name) for f in fields(self))
        return EnergyBalance(*values)

    @cached_property
    def parts(self) -> Array:
        """Supplied energy by cause (7, n) [J]; the rows are the causes in `PARTS`."""
        return np.array([getattr(self, name) for name in self.PARTS])

    @property
    def motors(self) -> Array:
        """Energy (n,) supplied to each motor [J]: all parts except standby."""
        return self.supplied - self.standby

    @property
    def supplied(self) -> Array:
        """Net energy (n,) that the supply delivers to each drive [J]."""
        total: Array = self.parts.sum(axis=0)
        return total

    def as_text(self, joint_names: tuple[str, ...]) -> str:
        """Return a text table of energies [J], with one line per joint and one for the sum."""
        heads = [*self.PARTS, 'supplied', 'recovered']
        columns = np.vstack([self.parts, self.supplied, self.recovered])
        table = np.column_stack([columns, columns.sum(axis=1)])
        width = max(map(len, (*joint_names, 'all')))
        lines = [' ' * width + ''.join(f'{head:>12}' for head in heads) + '   [J]']
        for name, column in zip((*joint_names, 'all'), table.T, strict=True):
            lines.append(f'{name:{width}}' + ''.join(f'{value:12.3f}' for value in column))
        return '\n'.join(lines)


_STEP = 2e-3  # [s]
_FRICTION_WIDTH = 0.02  # [rad/s] at which dry friction reaches three quarters of its value


class EnergyModel:
    """Model of the torque, power and energy of an arm's drives.

    Parameters
    ----------
    config : ArmConfig
        Configuration with drive train, resistances and power stage.
    robot : Robot
        Robot model with inertial parameters and friction f_v, f_s; a joint without friction in
        the URDF uses the friction of `config`.
    rotor_inertia : (n,) array_like, optional
        Rotor inertia at the joints [kg m^2]; by default from the configuration.
    load_friction : float or (n,) array_like, optional
        Dry friction per torque transmitted by a gear [-]; by default the robot's.

    Attributes
    ----------
    drives, dynamics, friction
        Underlying `DrivePower`, `Dynamics` and `FrictionCompensation`.
    load_friction
        Load-dependent friction (n,) [-] that the model uses.

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
        self.friction = self.friction_of_width(_FRICTION_WIDTH)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a payload to the last link, see `Dynamics.carry`."""
        self.dynamics.carry(payload)

    def friction_of_width(self, width: float) -> FrictionCompensation:
        """Return the friction model, smoothed over the velocity `width` [rad/s]."""
        share = self.load_friction
        return FrictionCompensation(self._viscous, self._coulomb, width, load_share=share)

    def friction_torque(self, dq: Array, ddq: Array, rigid: Array) -> Array:
        """Return the friction torque (..., n) [Nm] of a motion.

        Load-dependent friction is computed from the torque on the links, because the torque that
        accelerates the rotors does not pass through the gears.

        Parameters
        ----------
        dq, ddq : (..., n) ndarray
            Joint velocities [rad/s] and accelerations [rad/s^2].
        rigid : (..., n) ndarray
            Torques of the frictionless inverse dynamics, including rotors [Nm].
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
        return self.balance_of(dt, q, dq, ddq)

    def balance_of(
        self, dt: float, q: Array, dq: Array, ddq: Array, tau: Array | None = None
    ) -> EnergyBalance:
        """Return the energy balance of M time intervals, given the motion at their centres.

        Parameters
        ----------
        dt : float
            Duration of each interval [s].
        q, dq, ddq : (M, n) ndarray
            Positions [rad], velocities [rad/s] and accelerations [rad/s^2].
        tau : (M, n) ndarray, optional
            Measured drive torques [Nm]; by default those of the model.
        """
        rigid, weight = self.torques(q, dq, ddq)
        friction, inertia = self.friction_torque(dq, ddq, rigid), rigid - weight
        tau = rigid + friction if tau is None else tau
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
        """Return the torques of a motion without friction, and its gravity torques, (M, n) [Nm]."""
        rows = [
            (self.dynamics.inverse(*motion), self.dynamics.gravity(motion[0]))
            for motion in zip(q, dq, ddq, strict=True)
        ]
        rigid, weight = np.swapaxes(np.array(rows), 0, 1)
        return rigid, weight


class HoldingLoss:
    """Copper loss of the motors while they hold the arm at rest, thesis (4.1)."""

    def __init__(self, model: EnergyModel) -> None:
        self._dynamics, self._drives = model.dynamics, model.drives

    def watts(self, q: Array) -> float:
        """Return the copper loss [W] of all motors at the posture q (n,) [rad]."""
        return float(self._drives.copper(self._dynamics.gravity(q)).sum())

    def gradient(self, q: Array) -> Array:
        """Return the gradient (n,) of the copper loss by the posture q [W/rad]."""
        rest = np.zeros_like(q)
        weight, slopes, _, _ = self._dynamics.inverse_with_slopes(q, rest, rest)
        gradient: Array = 2.0 * (self._drives.copper_per_torque2 * weight) @ slopes
        return gradient


LONGEST_GAP = 0.1  # [s] largest time between consecutive states


# Averaging time of torque and velocity [s], minus half a millisecond for the jitter of the states.
# The noise of single velocities dominates the computed dry friction near rest, so 10 ms are better
# than 1 ms.
_PERIOD = 0.01 - 0.5e-3


class BalanceMeter:
    """Energy balance of an arm, accumulated from its states.

    A published torque is the mean since the previous state. For each period of 10 ms the meter
    uses the mean of these torques, the mean of the velocities at both ends of the period, and the
    acceleration from the difference of both velocities. The work into the motion thus equals the
    change of kinetic energy, and the noise of single velocities does not add up.

    Attributes
    ----------
    total : EnergyBalance
        Energy balance since the start.
    gaps : int
        Number of excluded intervals, in which states or torques were missing.
    """

    def __init__(self, model: EnergyModel) -> None:
        self._model = model
        self.total = EnergyBalance.nothing(model.n)
        self.gaps = 0
        self._begin: tuple[float, ArmState] | None = None
        self._last = 0.0
        # [Nms] time integral of the drive torques since `_begin`
        self._impulse = np.zeros(model.n)
        self._square = np.zeros(model.n)  # [Nm^2 s] time integral of the squared drive torques

    def restart(self) -> None:
        """Discard the last state, so that the next state starts a new interval."""
        self._begin = None

    def add(self, time: float, state: ArmState) -> bool:
        """Process the state at `time` [s]; return whether `total` has changed."""
        if not all(np.isfinite(values).all() for values in state):
            self.gaps += self._begin is not None
            self._begin = None
            return False
        if self._begin is None or not 0.0 < time - self._last <= LONGEST_GAP:
            self.gaps += self._begin is not None and time != self._last
            self._start(time, state)
            return False
        dt, self._last = time - self._last, time
        self._impulse += dt * state.tau
        self._square += dt * state.tau**2
        if time - self._begin[0] < _PERIOD:
            return False
        self._close(time, state)
        return True

    def _start(self, time: float, state: ArmState) -> None:
        self._begin, self._last = (time, state), time
        self._impulse[:] = self._square[:] = 0.0

    def _close(self, time: float, state: ArmState) -> None:
        assert self._begin is not None
        begun, first = self._begin
        dt = time - begun
        q, dq = 0.5 * (first.q + state.q), 0.5 * (first.dq + state.dq)
        ddq, tau = (state.dq - first.dq) / dt, self._impulse / dt
        interval = self._model.balance_of(dt, *(row[np.newaxis] for row in (q, dq, ddq, tau)))
        # Torque variation within the interval also causes copper loss.
        copper = self._model.drives.copper_per_torque2
        interval.copper[:] += copper * (self._square - dt * tau**2)
        self.total = self.total + interval
        self._start(time, state)
