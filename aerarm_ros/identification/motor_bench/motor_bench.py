"""Evaluation of motor bench runs: parameters of the drives, thesis section 4.4."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_backlash import (
    LARGEST,
    fit_backlash,
    is_largest,
    is_significant,
)
from aerarm_ros.identification.motor_bench.motor_friction import (
    RATE,
    MotorFriction,
    MotorResistance,
    MotorRun,
    MotorSupply,
    find_resistance,
    fit_motor_friction,
    moving_rows,
)
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.motion.signals import Array

# Largest relative standard deviation of the rotor inertia at which it counts as separable from
# the load.
_KNOWN = 0.3


@dataclass(frozen=True, eq=False)
class MotorResult:
    """Friction, inertia, torque constant and resistance of one joint's drive.

    Attributes
    ----------
    joint, motor : str
        Names in the arm's configuration.
    ratio : float
        Gear ratio k_g.
    torque_constant_stated : float
        Torque constant K_i that converted currents to torques [Nm/A].
    friction : MotorFriction
        Friction measured with the stated torque constant.
    inertia : tuple of two floats, or None
        Inertia that the drive accelerates at the joint, with its standard deviation [kg m^2],
        computed with the stated torque constant.
    carried_inertia : tuple of two floats
        Inertia of the load without the drive, with its standard deviation [kg m^2].
    torque_ratio : tuple of two floats, or None
        Ratio of true to stated torque constant, with its standard deviation; None if not measured.
    resistance : MotorResistance or None
        Phase resistance; None if neither voltages nor the board provide it.
    backlash : tuple of two floats, or None
        Gear backlash at the joint, with its standard deviation [rad]; None if not measured.
    """

    joint: str
    motor: str
    ratio: float
    torque_constant_stated: float
    friction: MotorFriction
    inertia: tuple[float, float] | None = None
    carried_inertia: tuple[float, float] = (0.0, 0.0)
    torque_ratio: tuple[float, float] | None = None
    resistance: MotorResistance | None = None
    backlash: tuple[float, float] | None = None

    @property
    def scale(self) -> float:
        """Ratio of true to measured torque; 1 if the torque constant was not measured."""
        return self.torque_ratio[0] if self.torque_ratio else 1.0

    @property
    def viscous(self) -> tuple[float, float]:
        """Viscous friction b_eq / k_g^2 at the joint, with its standard deviation [Nms/rad]."""
        friction = self.friction
        return self.scale * friction.viscous, self.scale * float(friction.std[0])

    @property
    def viscous_motor(self) -> tuple[float, float]:
        """Motor-side b_eq of thesis table 4.3, with its standard deviation [Nms/rad]."""
        value, std = self.viscous
        return self.ratio**2 * value, self.ratio**2 * std

    @property
    def coulomb(self) -> tuple[float, float]:
        """Coulomb friction f of thesis table 4.3 at the joint, with its standard deviation [Nm]."""
        return self.scale * self.friction.coulomb, self.scale * float(self.friction.std[1])

    @property
    def torque_constant(self) -> tuple[float, float] | None:
        """Torque constant K_i [Nm/A] with its standard deviation, None if not measured."""
        if self.torque_ratio is None:
            return None
        stated = self.torque_constant_stated
        return stated * self.torque_ratio[0], stated * self.torque_ratio[1]

    @property
    def rotor_inertia(self) -> tuple[float, float] | None:
        """Motor-side rotor inertia J_m [kg m^2], with standard deviation; None if not measured."""
        if self.inertia is None:
            return None
        (total, std), (carried, carried_std) = self.inertia, self.carried_inertia
        value = self.scale * total - carried
        return self.ratio**2 * value, self.ratio**2 * float(np.hypot(std, carried_std))

    @property
    def rotor_inertia_known(self) -> bool:
        """Whether the rotor inertia is distinguishable from the inertia of the load."""
        found = self.rotor_inertia
        return found is not None and 0.0 < found[1] < _KNOWN * found[0]


_LARGEST_BACKLASH = 0.05  # [rad] largest assumed backlash of a joint


def backlash_shifts(
    dynamics: Dynamics, posture: Array, joint: int, amplitude: float, acceleration: float
) -> Array:
    """Return the largest shift (n,) [rad] of the oscillating link due to each joint's backlash.

    An accelerating joint causes torques at the other joints through their inertial coupling. A
    gear stays at its tooth flank if the gravity torque on it is larger than this coupling torque.
    With a smaller gravity torque, the joint moves within its backlash and shifts the oscillating
    link.

    Parameters
    ----------
    dynamics : Dynamics
        Dynamic model of the arm.
    posture : (n,) ndarray
        Posture about which the joint oscillates [rad].
    joint : int
        Index of the oscillating joint.
    amplitude, acceleration : float
        Largest amplitude [rad] and acceleration [rad/s^2] of its motion.
    """
    inertia = np.abs(dynamics.inertia_matrix(posture))
    gravity = np.abs(dynamics.gravity(posture))
    coupling, own = inertia[joint], np.diag(inertia)
    moves = np.minimum(_LARGEST_BACKLASH, amplitude * coupling / own)
    shift = np.where(gravity > coupling * acceleration, 0.0, moves * coupling / own[joint])
    shift[joint] = 0.0
    return np.asarray(shift)


_CUTOFF = 12.0  # [Hz] zero-phase low-pass filter, above the frequencies of a run
_ORDER = 3
# multiples of the filter's time constant excluded at both ends, where samples exist on one side
# only
_ENDS = 5
_STEP = 20  # number of samples from one regression row to the next
_INDEPENDENT = 0.5 / _CUTOFF  # [s] between samples with independent noise


def fit_inertia(
    runs: Sequence[MotorRun], friction: MotorFriction, name: str
) -> tuple[float, float]:
    """Return the inertia that a drive accelerates, and the standard deviation [kg m^2].

    The gravity torque is that of the velocity steps. Viscous and Coulomb friction are fitted
    again, because acceleration runs are faster than velocity steps. Torque and regressor pass the
    same filter, so that the balance (4.11) holds after filtering.

    Parameters
    ----------
    runs : sequence of MotorRun
        Acceleration runs of one joint.
    friction : MotorFriction
        Friction from the velocity steps.
    name : str
        Name of the joint, for error messages.

    Raises
    ------
    IdentificationError
        If the runs are too short or the inertia is not positive.
    """
    filtered = [_filtered(run, friction) for run in runs if run.is_long_enough()]
    if not filtered:
        raise IdentificationError(
            f'{name}: the acceleration runs are shorter than 0.5 s; measure more or longer runs'
        )
    columns, torque = (np.concatenate(part) for part in zip(*filtered, strict=True))
    theta, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    residual = torque - columns @ theta
    variance = residual @ residual / max(len(torque) - columns.shape[1], 1)
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    if theta[0] <= 0.0:
        raise IdentificationError(
            f'{name}: the measured inertia, {theta[0]:.3g} kg m^2, is not positive; check the '
            'sign of the motor, and raise the acceleration fraction'
        )
    return float(theta[0]), float(np.sqrt(covariance[0, 0]))


def _filtered(run: MotorRun, friction: MotorFriction) -> tuple[Array, Array]:
    """Return ddq, dq, sgn(dq) and the torque without gravity, through one low-pass filter."""
    # Local import, because scipy.signal takes longer to import than the rest of this module.
    from scipy.signal import butter, sosfiltfilt

    q, tau = run.uniform()
    low_pass = butter(_ORDER, _CUTOFF, fs=RATE, output='sos')
    smooth = sosfiltfilt(low_pass, q)
    dq = np.gradient(smooth, 1.0 / RATE)
    ddq = np.gradient(dq, 1.0 / RATE)
    rest = tau - friction.load_torque(smooth, dq)
    edge = round(_INDEPENDENT * RATE)
    columns = np.column_stack([ddq, dq, sosfiltfilt(low_pass, np.sign(dq))])
    rows = moving_rows(dq, edge, _ENDS * edge, _STEP)
    return columns[rows], sosfiltfilt(low_pass, rest)[rows]


# Smallest gravity torque of the known mass, in standard deviations, for which the torque constant
# is measured.
_SIGNIFICANT = 20.0
_PLAUSIBLE = 2.0  # largest ratio between true and stated torque constant


def fit_torque_constant(
    friction: MotorFriction, without: Array | None, known: Array | float, name: str
) -> tuple[float, float]:
    """Return the ratio of true to stated torque constant, and its standard deviation [-].

    Measured current and stated constant give a measured torque of the mass; weight and lever give
    its true torque. Gear friction cancels in the mean of both directions of motion, because it
    changes its sign with the direction and the gravity torque does not.

    Parameters
    ----------
    friction : MotorFriction
        Friction fitted with the mass.
    without : (2,) ndarray or None
        Gravity parameters a and b [Nm] without the mass; None for a bare motor without other load.
    known : (2,) ndarray or float
        True contribution of the mass to a and b [Nm]; or m g r [Nm] if the lever's angle is
        unknown.
    name : str
        Name of the joint, for error messages.

    Raises
    ------
    IdentificationError
        If the mass's torque is too small to measure, or does not match its weight.
    """
    added = friction.gravity - (0.0 if without is None else without)
    spread = friction.covariance[3:, 3:] * (1.0 if without is None else 2.0)
    size = float(np.linalg.norm(known))
    direction = added if np.ndim(known) == 0 else np.asarray(known)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    measured = float(added @ direction)
    std = float(np.sqrt(direction @ spread @ direction))
    if size < _SIGNIFICANT * std or size == 0.0:
        raise IdentificationError(
            f'{name}: the known mass causes at most {size:.3g} Nm, measured with a standard '
            f'deviation of {std:.2g} Nm; choose a posture with a longer lever arm of the mass '
            'about this joint, or a larger mass'
        )
    if not size / _PLAUSIBLE < measured < size * _PLAUSIBLE:
        raise IdentificationError(
            f'{name}: the known mass adds {measured:.3g} Nm instead of the expected {size:.3g} Nm; '
            'check the mass, its position, and that both runs have the same posture'
        )
    ratio = size / measured
    return ratio, ratio * std / measured


# repeated, because the evaluation of the steps needs the inertia from the runs, and the runs need
# the gravity from the steps
_ROUNDS = 2
_SAME_POSTURE = 0.02  # [rad]
_SHIFT = 3e-3  # [rad] link shift by other joints' backlash above which a warning appears
_LEAST_SPREAD = 0.05  # smallest relative standard deviation of the links' inertia
_ROTOR_SPREAD = 0.3  # relative standard deviation of the configured rotor inertia


@dataclass(frozen=True)
class KnownMass:
    """Known mass attached to the arm's last link, or to a lever on a bare motor's shaft.

    Attributes
    ----------
    mass : float
        Known mass [kg].
    position : tuple of three floats
        Centre of mass in the frame of the last link's joint [m], for a mounted arm.
    lever : float
        Distance of the centre of mass from the horizontal shaft [m], for a bare motor.
    """

    mass: float
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    lever: float = 0.0


@dataclass(frozen=True, eq=False)
class Earlier:
    """Results of an earlier motor bench run, without the known mass.

    Attributes
    ----------
    gravity : mapping
        Parameters a and b (2,) [Nm] of the gravity torque `a sin q + b cos q`, by joint name.
    posture : (n,) ndarray
        Posture of that run [rad].
    """

    gravity: Mapping[str, Array]
    posture: Array


class MotorBench:
    """Evaluation of the runs of a motor bench.

    Parameters
    ----------
    config : ArmConfig
        Configuration with the torque constants that were used to convert currents to torques.
    robot : Robot or None
        Mounted arm with links under gravity; None for bare motors.
    posture : (n,) array_like
        Angles of the joints at rest [rad].
    known : KnownMass, optional
        Known mass for measuring the torque constants.
    earlier : Earlier, optional
        Run without the mass, required for a mounted arm.
    link_uncertainty : float
        Relative standard deviation of the links' inertia in the URDF.
    resistance_uncertainty : float
        Relative standard deviation of a resistance that a board reports.

    Raises
    ------
    IdentificationError
        If the torque constants cannot be measured with the known mass.
    """

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot | None,
        posture: npt.ArrayLike,
        known: KnownMass | None = None,
        earlier: Earlier | None = None,
        link_uncertainty: float = 0.2,
        resistance_uncertainty: float = 0.1,
    ) -> None:
        self._config = config
        self._robot = robot
        self._posture = np.array(posture, dtype=float)
        self._known = known
        self._earlier = earlier
        self._link_uncertainty = link_uncertainty
        self._resistance_uncertainty = resistance_uncertainty
        self.warnings: list[str] = []
        if known is not None:
            self._check_known(known)
        if robot is not None:
            self._alone = self._loaded = Dynamics(robot)
            if known is not None:
                inertial = np.array(robot.inertial_parameters)
                inertial[-1] += point_mass(known.mass, known.position)
                self._loaded = Dynamics(robot.with_inertial_parameters(inertial))

    def evaluate(
        self, joint: int, runs: Sequence[MotorRun], supply: MotorSupply | None = None
    ) -> MotorResult:
        """Evaluate the runs of one joint; warn about each quantity that is not identified.

        The resistance comes from `supply`, the electrical measurements of the boards.

        Raises
        ------
        IdentificationError
            If the runs do not determine the friction.
        """
        drive = self._config.joints[joint]
        steps = [run for run in runs if run.speed is not None]
        accelerations = [run for run in runs if run.speed is None and not run.swings]
        swings = [run for run in runs if run.swings]
        hanging = self._robot is not None or self._known is not None
        carried = self._carried_inertia(joint)
        inertia = (drive.reflected_inertia + carried[0], np.inf)
        friction = fit_motor_friction(steps, hanging, drive.name, inertia[0])
        for _ in range(_ROUNDS if accelerations else 0):
            inertia = fit_inertia(accelerations, friction, drive.name)
            friction = fit_motor_friction(steps, hanging, drive.name, inertia[0])
        result = MotorResult(
            joint=drive.name,
            motor=drive.motor.name,
            ratio=drive.gear.ratio,
            torque_constant_stated=drive.motor.torque_constant,
            friction=friction,
            inertia=inertia if accelerations else None,
            carried_inertia=carried,
            torque_ratio=self._torque_ratio(joint, friction),
            resistance=find_resistance(supply, self._resistance_uncertainty) if supply else None,
            backlash=self._backlash(joint, swings, friction),
        )
        if result.inertia is not None and not result.rotor_inertia_known:
            self.warnings.append(
                f'{drive.name}: rotor inertia and load inertia are not separable '
                f'({result.carried_inertia[0]:.3g} of {result.inertia[0]:.3g} kg m^2); measure '
                'in a posture with less inertia about its axis, or measure the bare motor'
            )
        return result

    def _backlash(
        self, joint: int, swings: Sequence[MotorRun], friction: MotorFriction
    ) -> tuple[float, float] | None:
        """Estimate a gear's backlash from oscillations; other joints' backlash adds uncertainty."""
        if not swings or self._robot is None:
            return None
        drive, posture = self._config.joints[joint], self._posture
        carried = self._carried_inertia(joint)
        links = (carried[0], max(carried[1], _LEAST_SPREAD * carried[0]))
        rotor = drive.reflected_inertia
        try:
            backlash, std = fit_backlash(
                swings, friction, links, (rotor, _ROTOR_SPREAD * rotor), drive.name
            )
        except IdentificationError as error:
            self.warnings.append(f'backlash not measured: {error}')
            return None
        recorded = [run for run in swings if len(run.time)]
        amplitude = 0.5 * max(float(np.ptp(run.q)) for run in recorded)
        fastest = max(float(np.abs(run.dq).max()) for run in recorded)
        shift = backlash_shifts(self._loaded, posture, joint, amplitude, fastest**2 / amplitude)
        # The shift by other joints' backlash is assumed to be equally likely between zero and its
        # largest value.
        found = backlash, float(np.hypot(std, 0.5 * np.linalg.norm(shift)))
        others = [self._config.joint_names[i] for i in np.flatnonzero(shift > _SHIFT)]
        if others:
            self.warnings.append(
                f'{drive.name}: {", ".join(others)} may move within their backlash, so '
                'the measured backlash may include the backlash of these joints; choose a posture '
                'in which gravity presses their gears to one side, or in which they do not move'
            )
        if not is_significant(found):
            self.warnings.append(
                f'{drive.name}: backlash {1000.0 * found[0]:.1f} ± {1000.0 * found[1]:.1f} mrad is '
                'not significant; for a more accurate result choose a posture with a large inertia '
                'about this joint, in which gravity does not load the gear'
            )
        elif is_largest((backlash, std)):
            self.warnings.append(
                f'{drive.name}: backlash is at least {1e3 * LARGEST:.0f} mrad, the largest '
                'measurable value; inspect the gear'
            )
        return found

    def _check_known(self, known: KnownMass) -> None:
        if self._robot is None:
            if not known.lever > 0.0:
                raise IdentificationError(
                    'a known mass on a bare motor needs its lever arm: set its distance from '
                    'the shaft [m]'
                )
        elif self._earlier is None:
            raise IdentificationError(
                'a mass on a mounted arm needs a run without it: first measure without the mass'
            )
        elif np.abs(self._earlier.posture - self._posture).max() > _SAME_POSTURE:
            raise IdentificationError(
                'the posture of the run without the mass, '
                f'{self._earlier.posture.round(3).tolist()} rad, differs from the posture of this '
                'run, '
                f'{self._posture.round(3).tolist()} rad: choose the same posture'
            )

    def _torque_ratio(self, joint: int, friction: MotorFriction) -> tuple[float, float] | None:
        name, known, robot = self._config.joint_names[joint], self._known, self._robot
        if known is None:
            return None
        try:
            if robot is None:
                gravity = float(np.linalg.norm(self._config.gravity_in_base))
                weight = known.mass * gravity * known.lever
                return fit_torque_constant(friction, None, weight, name)
            assert self._earlier is not None  # checked in the constructor
            if name not in self._earlier.gravity:
                raise IdentificationError(
                    f'{name}: the run without the mass has no result for this joint'
                )
            expected = self._known_gravity(joint)
            return fit_torque_constant(friction, self._earlier.gravity[name], expected, name)
        except IdentificationError as error:
            self.warnings.append(f'torque constant not measured: {error}')
            return None

    def _known_gravity(self, joint: int) -> Array:
        """Return the known mass's part of the gravity coefficients a and b [Nm]."""
        values = []
        for angle in (0.5 * np.pi, 0.0):
            q = self._posture.copy()
            q[joint] = angle
            values.append(self._loaded.gravity(q)[joint] - self._alone.gravity(q)[joint])
        return np.array(values)

    def _carried_inertia(self, joint: int) -> tuple[float, float]:
        """Return the inertia of the load about the joint, and its standard deviation [kg m^2]."""
        if self._robot is None:
            return (self._known.mass * self._known.lever**2 if self._known else 0.0), 0.0
        both, links = (
            float(dynamics.inertia_matrix(self._posture)[joint, joint])
            for dynamics in (self._loaded, self._alone)
        )
        return both, self._link_uncertainty * links
