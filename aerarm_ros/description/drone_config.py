"""Configuration of the drone that carries the arm, read from YAML."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_reader import (
    ConfigError,
    build,
    check_fields,
    check_keys,
    check_unique,
    load,
    ranged,
    section,
    vector,
)
from aerarm_ros.motion.signals import Array

_LENGTH_BOUND = 5.0  # [m]; a larger position is probably in millimetres
_ANGLE_BOUND = 6.3  # [rad]; a larger angle is probably in degrees


@dataclass(frozen=True, slots=True)
class PoseConfig:
    """Pose of a part's frame (mount or IMU) in the body frame of the drone.

    Attributes
    ----------
    position : tuple of 3 floats
        Position of the part's origin [m].
    rpy : tuple of 3 floats
        Roll, pitch and yaw [rad] about the body's axes in this order, as in a URDF's `<origin>`.

    Raises
    ------
    ConfigError
        If a number is missing or outside any plausible range.
    """

    position: tuple[float, ...] = vector(_LENGTH_BOUND, 'm')
    rpy: tuple[float, ...] = vector(_ANGLE_BOUND, 'rad', default=(0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields('pose', self)

    @property
    def rotation(self) -> Array:
        """Rotation matrix (3, 3) from the part's axes to the body's axes."""
        (cr, cp, cy), (sr, sp, sy) = (
            [function(angle) for angle in self.rpy] for function in (math.cos, math.sin)
        )
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )


_UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class RotorConfig:
    """Propeller with its motor; the command is the thrust.

    Attributes
    ----------
    name : str
        Name in the topic rotor_command.
    position : tuple of 3 floats
        Position of the hub in the body frame [m].
    axis : tuple of 3 floats
        Direction of the thrust on the body, a unit vector in body axes.
    moment_per_thrust : float
        Drag moment on the body about `axis` per thrust [Nm/N], with a magnitude of about 0.01 to
        0.02. Positive if the propeller turns clockwise, seen from the tip of its axis.
    thrust_max : float
        Largest thrust [N].
    time_constant : float
        Time constant of the first-order lag from commanded to true thrust [s].
    thrust_min : float
        Smallest thrust [N]; zero for a propeller that may stop, negative for a reversible one.

    Raises
    ------
    ConfigError
        If a value is outside its range or contradicts another.
    """

    name: str
    position: tuple[float, ...] = vector(_LENGTH_BOUND, 'm')
    axis: tuple[float, ...] = vector(10.0, '')
    moment_per_thrust: float = ranged(-1.0, 1.0, 'Nm/N')
    thrust_max: float = ranged(1e-3, 1e4, 'N')
    time_constant: float = ranged(1e-4, 1.0, 's')
    thrust_min: float = ranged(-1e4, 1e4, 'N', default=0.0)

    def __post_init__(self) -> None:
        """Validate all values."""
        owner = f'rotor {self.name}'
        check_fields(owner, self)
        length = math.hypot(*self.axis)
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise ConfigError(
                f'{owner}: axis has length {length:.4g} instead of 1; give a unit vector, for '
                'example [0, 0, 1] for thrust upwards'
            )
        if self.thrust_min >= self.thrust_max:
            raise ConfigError(
                f'{owner}: thrust_min = {self.thrust_min} must be below '
                f'thrust_max = {self.thrust_max}'
            )

    @property
    def wrench_per_thrust(self) -> npt.NDArray[np.float64]:
        """Force [-] and moment [m] about the body's origin per thrust of this rotor, (6,)."""
        axis = np.array(self.axis) / math.hypot(*self.axis)
        moment = np.cross(self.position, axis) + self.moment_per_thrust * axis
        return np.concatenate([axis, moment])


GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]."""
THRUST_RESERVE = 1.2
"""Smallest accepted ratio of a level drone's largest thrust without moment to its weight.
The excess over 1 is a reserve for rotating and stopping the drone.
"""

# smallest sideways force that counts, relative to the thrust along the body's z axis
_FULL_ACTUATION = 0.05
_ROUNDING = 1e-9
_EDGE = 1e-6  # [m]


@dataclass(frozen=True, slots=True)
class DroneConfig:
    """Drone without its arm: a rigid body with rotors, a mount for an arm and an IMU.

    The body frame (forward, left, up) has its origin in the middle of the body's box. The body
    frame is the base of the combined drone and arm.

    Attributes
    ----------
    mass : float
        Mass without the arm [kg].
    centre_of_mass : tuple of 3 floats
        Centre of mass in the body frame [m].
    inertia : tuple of 6 floats
        ixx, iyy, izz, ixy, ixz, iyz [kg m^2] about the centre of mass in body axes; off-diagonal
        entries have the tensor's sign, as in a URDF.
    size : tuple of 3 floats
        Size of the body's box [m], without the rotor arms; it contains centre of mass, mount and
        IMU.
    mount : PoseConfig
        Pose of the arm's base frame (base_link) in the body frame.
    imu : PoseConfig
        Pose of the IMU's frame in the body frame.

    Raises
    ------
    ConfigError
        If a value is outside its range, the inertia is not physically possible, a part is not on
        the body, or the rotors cannot hover or lift the drone.
    """

    name: str
    mount: PoseConfig
    imu: PoseConfig
    rotors: tuple[RotorConfig, ...]
    mass: float = ranged(0.05, 500.0, 'kg')
    centre_of_mass: tuple[float, ...] = vector(_LENGTH_BOUND, 'm')
    inertia: tuple[float, ...] = ranged(-1e3, 1e3, 'kg m^2')
    size: tuple[float, ...] = vector(_LENGTH_BOUND, 'm')

    def __post_init__(self) -> None:
        """Check all values, and conditions that concern several parts of the drone."""
        check_fields('drone', self)
        if min(self.size) <= 0.0:
            raise ConfigError(f'drone: size = {list(self.size)} [m] must be positive')
        self._check_inertia()
        self._check_on_body('centre_of_mass', self.centre_of_mass)
        self._check_on_body('mount', self.mount.position)
        self._check_on_body('imu', self.imu.position)
        self._check_rotors()
        self._check_reach()

    @property
    def n(self) -> int:
        """Number of rotors."""
        return len(self.rotors)

    @property
    def rotor_names(self) -> tuple[str, ...]:
        """Names of the rotors, in the order of all arrays."""
        return tuple(rotor.name for rotor in self.rotors)

    @property
    def inertia_matrix(self) -> Array:
        """Inertia matrix (3, 3) about the centre of mass in body axes [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def allocation(self) -> Array:
        """Allocation matrix (6, n): force [-] and moment [m] on the body per rotor thrust."""
        return np.column_stack([rotor.wrench_per_thrust for rotor in self.rotors])

    @property
    def is_fully_actuated(self) -> bool:
        """Whether the rotors can produce force in any direction without changing the moment."""
        matrix = self.allocation
        matrix[3:] /= self._arm_length
        smallest = np.linalg.svd(matrix, compute_uv=False)
        return len(smallest) == 6 and bool(smallest[-1] > _FULL_ACTUATION)

    @property
    def gravity_in_base(self) -> Array:
        """Gravity (3,) in the arm's base frame [m/s^2] while the drone is level."""
        return self.mount.rotation.T @ (0.0, 0.0, -GRAVITY)

    def column(self, field: str) -> Array:
        """Return the values (n,) of one numeric attribute of all rotors, such as 'thrust_max'."""
        return np.array([getattr(rotor, field) for rotor in self.rotors], dtype=float)

    def with_errors(self, mass: float = 1.0, inertia: float = 1.0) -> 'DroneConfig':
        """Return a copy with scaled mass and inertia, to simulate errors in the drone file."""
        tensor = tuple(inertia * value for value in self.inertia)
        return replace(self, mass=mass * self.mass, inertia=tensor)

    def check_carries(self, mass: float, centre_in_base: npt.ArrayLike) -> None:
        """Check that the level rotors can lift drone and arm, with a reserve.

        Parameters
        ----------
        mass : float
            Mass of the arm and its payload [kg].
        centre_in_base : (3,) array_like
            Centre of that mass in the arm's base frame [m].

        Raises
        ------
        ConfigError
            If the rotors cannot lift drone and arm.
        """
        centre = np.array(self.mount.position) + self.mount.rotation @ np.asarray(centre_in_base)
        total = self.mass + mass
        middle = (self.mass * np.array(self.centre_of_mass) + mass * centre) / total
        weight = f'the weight of drone and arm ({self.mass:g} + {mass:.3g} kg)'
        advice = ', or use stronger rotors, a lighter arm, or a central mount'
        self._check_lift(total, middle, f'drone {self.name}', weight, advice)

    @property
    def _arm_length(self) -> float:
        """RMS distance of the rotors from the body frame's origin [m]."""
        places = np.array([rotor.position for rotor in self.rotors])
        return float(np.sqrt(np.mean(np.sum(places**2, axis=1)))) or 1.0

    @property
    def _reach(self) -> float:
        """Distance from the centre of mass to the most distant part of body and rotors [m]."""
        centre = np.array(self.centre_of_mass)
        corner = 0.5 * np.array(self.size) + np.abs(centre)
        hubs = np.array([rotor.position for rotor in self.rotors]) - centre
        return float(np.linalg.norm(np.vstack([corner, hubs]), axis=1).max())

    def _check_lift(
        self, mass: float, centre: Array, owner: str, weighed: str, advice: str = ''
    ) -> None:
        """Compare the largest vertical force without moment with the weight."""
        from scipy.optimize import linprog  # slow import, needed only for checks of files

        weight = np.array([0.0, 0.0, mass * GRAVITY])
        wanted = np.concatenate([weight, np.cross(centre, weight)])
        equations = np.column_stack([self.allocation, -wanted])
        bounds = [(rotor.thrust_min, rotor.thrust_max) for rotor in self.rotors]
        result = linprog(
            np.append(np.zeros(self.n), -1.0),
            A_eq=equations,
            b_eq=np.zeros(6),
            bounds=[*bounds, (0.0, None)],
        )
        share = max(0.0, -float(result.fun)) if result.success else 0.0
        if share < THRUST_RESERVE:
            raise ConfigError(
                f'{owner}: with level rotors its largest thrust is {share:.2f} times {weighed}, '
                f'below the minimum of {THRUST_RESERVE:g} times; check thrust_max, thrust_min and '
                f'mass{advice}'
            )

    def _check_inertia(self) -> None:
        if len(self.inertia) != 6:
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} needs ixx, iyy, izz, ixy, ixz and iyz'
            )
        small, middle, large = np.linalg.eigvalsh(self.inertia_matrix)
        if small <= 0.0 or large > (small + middle) * (1.0 + _ROUNDING):
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} has the principal moments {small:.3g}, '
                f'{middle:.3g}, {large:.3g} kg m^2; all must be positive, and none may be larger '
                'than the sum of the others'
            )

    def _check_reach(self) -> None:
        # The upper bound assumes all of the mass at the distance of the most distant part.
        largest = self.mass * self._reach**2
        moment = float(np.linalg.eigvalsh(self.inertia_matrix)[-1])
        if moment > largest:
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} has the principal moment {moment:.3g} kg '
                f'm^2, but {self.mass:g} kg within the extent of body and rotors have at most '
                f'{largest:.3g} kg m^2; check the unit [kg m^2], mass, size and rotors'
            )

    def _check_on_body(self, key: str, place: tuple[float, ...]) -> None:
        if any(abs(x) > 0.5 * length + _EDGE for x, length in zip(place, self.size, strict=True)):
            raise ConfigError(
                f'drone: {key} at {list(place)} m is outside the body, whose box of '
                f'{list(self.size)} m is centred at the body frame; check {key} and size'
            )

    def _check_rotors(self) -> None:
        if not self.rotors:
            raise ConfigError('drone: rotors is empty; list at least four rotors')
        check_unique('rotors', 'name', self.rotor_names)
        # Hovering needs thrust along z and three moments.
        matrix = self.allocation[2:]
        matrix[1:] /= self._arm_length
        if np.linalg.matrix_rank(matrix, tol=1e-4) < 4:
            raise ConfigError(
                'drone: these rotors cannot produce thrust and the three moments independently; '
                'check their positions, axes and the signs of moment_per_thrust'
            )
        weight = f'its weight ({self.mass:g} kg)'
        self._check_lift(self.mass, np.array(self.centre_of_mass), 'drone', weight)


def load_drone_config(path: Path | str | None = None) -> DroneConfig:
    """Read a drone configuration.

    Parameters
    ----------
    path : Path or str, optional
        YAML file in the format of the packaged config/drone.yaml, which is the default.

    Raises
    ------
    ConfigError
        If the file cannot be read or is invalid; the one-line message names file and key.
    """
    return load(path, 'drone.yaml', _drone)


def _drone(document: dict[str, Any]) -> DroneConfig:
    check_keys('top level', document, DroneConfig)
    rotors = tuple(
        build(RotorConfig, f'rotors[{index}]', entry)
        for index, entry in enumerate(section(document, 'rotors', list))
    )
    mount, imu = (_pose(key, document[key]) for key in ('mount', 'imu'))
    return build(
        DroneConfig, 'top level', {**document, 'mount': mount, 'imu': imu, 'rotors': rotors}
    )


def _pose(where: str, entry: Any) -> PoseConfig:
    try:
        return build(PoseConfig, where, entry)
    except ConfigError as error:
        # The error message of the pose lacks the name of the part, so it is added.
        raise ConfigError(str(error).replace('pose:', f'{where}:', 1)) from None
