"""The drone that carries the arm, read from YAML."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_error import ConfigError, check_name, check_range
from aerarm_ros.description.config_reader import build, check_keys, load, section
from aerarm_ros.description.pose_config import PoseConfig, check_position, check_vector
from aerarm_ros.description.rotor_config import RotorConfig

Array = npt.NDArray[np.float64]

GRAVITY = 9.81
"""[m/s^2]"""
THRUST_RESERVE = 1.2
"""Thrust that level rotors must be able to give over the weight, without a moment: what is left is
all that turns and stops the drone."""

_FULL_ACTUATION = 0.05  # smallest sideways force over the thrust along the body's z, per unit of it
_ROUNDING = 1e-9
_EDGE = 1e-6  # [m]


@dataclass(frozen=True, slots=True)
class DroneConfig:
    """A drone without its arm: a rigid body with rotors, an arm's mount and an IMU.

    The body frame (forward, left, up) has its origin in the middle of the body's box. It is the
    base of drone and arm as a whole.

    Attributes
    ----------
    name : str
    mass : float
        Of everything but the arm [kg].
    centre_of_mass : tuple of 3 floats
        In the body frame [m].
    inertia : tuple of 6 floats
        ixx, iyy, izz, ixy, ixz, iyz [kg m^2] about the centre of mass in body axes, off-diagonal
        entries with the tensor's own sign, as in a URDF.
    size : tuple of 3 floats
        Of the body's box [m], without what only rotors are on; it holds centre of mass, mount, IMU.
    mount : PoseConfig
        Of the arm's base frame (base_link) in the body frame.
    imu : PoseConfig
        Of the IMU's frame in the body frame.
    rotors : tuple of RotorConfig

    Raises
    ------
    ConfigError
        If a value lies outside its range, no body has the inertia, a part isn't on the body, or
        the rotors can neither hold the drone level nor lift it.
    """

    name: str
    mass: float
    centre_of_mass: tuple[float, ...]
    inertia: tuple[float, ...]
    size: tuple[float, ...]
    mount: PoseConfig
    imu: PoseConfig
    rotors: tuple[RotorConfig, ...]

    def __post_init__(self) -> None:
        """Check every value, and what involves more than one part."""
        check_name('drone', 'name', self.name)
        check_range('drone', 'mass', self.mass, 0.05, 500.0, 'kg')
        check_position('drone', 'centre_of_mass', self.centre_of_mass)
        check_vector('drone', 'size', self.size, 5.0, 'm')
        if min(self.size) <= 0.0:
            raise ConfigError(f'drone: size = {list(self.size)} must be positive [m]')
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
        """(3, 3) inertia about the centre of mass in body axes [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def allocation(self) -> Array:
        """(6, n) force [-] and moment [m] at the body frame's origin, in its axes, per N."""
        return np.column_stack([rotor.wrench_per_thrust for rotor in self.rotors])

    @property
    def is_fully_actuated(self) -> bool:
        """Whether force and moment can be chosen freely, sideways too."""
        matrix = self.allocation
        matrix[3:] /= self._arm_length
        smallest = np.linalg.svd(matrix, compute_uv=False)
        return len(smallest) == 6 and bool(smallest[-1] > _FULL_ACTUATION)

    @property
    def gravity_in_base(self) -> Array:
        """(3,) gravity in the arm's base frame [m/s^2] while the drone is level."""
        return self.mount.rotation.T @ (0.0, 0.0, -GRAVITY)

    def column(self, field: str) -> Array:
        """Return one number of every rotor, (n,), as 'thrust_max', in the rotors' order."""
        return np.array([getattr(rotor, field) for rotor in self.rotors], dtype=float)

    def with_errors(self, mass: float = 1.0, inertia: float = 1.0) -> 'DroneConfig':
        """Return the drone with mass and inertia times a factor each: what a wrong file says."""
        tensor = tuple(inertia * value for value in self.inertia)
        return replace(self, mass=mass * self.mass, inertia=tensor)

    def check_carries(self, mass: float, centre_in_base: npt.ArrayLike) -> None:
        """Require that the rotors can lift drone and arm, level and with a reserve.

        Parameters
        ----------
        mass : float
            Of the arm and what it carries [kg].
        centre_in_base : (3,) array_like
            Its centre of mass in the arm's base frame [m].

        Raises
        ------
        ConfigError
            If they can't.
        """
        centre = np.array(self.mount.position) + self.mount.rotation @ np.asarray(centre_in_base)
        total = self.mass + mass
        middle = (self.mass * np.array(self.centre_of_mass) + mass * centre) / total
        share = self._liftable_share(total, middle)
        if share < THRUST_RESERVE:
            raise ConfigError(
                f'drone {self.name}: its rotors lift {share:.2f} times the weight of drone and arm '
                f'({self.mass:g} + {mass:.3g} kg) while it is level, and must lift '
                f'{THRUST_RESERVE:g} times it: stronger rotors, a lighter arm, or a mount nearer '
                'to the middle; or check thrust_max, thrust_min and mass'
            )

    @property
    def _arm_length(self) -> float:
        """Root mean square distance of the rotors from the origin [m]."""
        places = np.array([rotor.position for rotor in self.rotors])
        return float(np.sqrt(np.mean(np.sum(places**2, axis=1)))) or 1.0

    @property
    def _reach(self) -> float:
        """Distance from the centre of mass to the farthest part of body and rotors [m]."""
        centre = np.array(self.centre_of_mass)
        corner = 0.5 * np.array(self.size) + np.abs(centre)
        hubs = np.array([rotor.position for rotor in self.rotors]) - centre
        return float(np.linalg.norm(np.vstack([corner, hubs]), axis=1).max())

    def _liftable_share(self, mass: float, centre: Array) -> float:
        """Return the largest vertical force over a weight, without moment about its centre."""
        from scipy.optimize import linprog  # slow to import, and only checked files need it

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
        return max(0.0, -float(result.fun)) if result.success else 0.0

    def _check_inertia(self) -> None:
        if len(self.inertia) != 6:
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} needs ixx, iyy, izz, ixy, ixz and iyz'
            )
        for value in self.inertia:
            check_range('drone', 'inertia', value, -1e3, 1e3, 'kg m^2')
        principal = np.linalg.eigvalsh(self.inertia_matrix)
        if principal[0] <= 0.0:
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} has the principal moment '
                f'{principal[0]:.3g} kg m^2: all three must be positive'
            )
        if principal[2] > (principal[0] + principal[1]) * (1.0 + _ROUNDING):
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} has principal moments '
                f'{principal[0]:.3g}, {principal[1]:.3g}, {principal[2]:.3g} kg m^2, which no body '
                'has: none may be larger than the sum of the others'
            )

    def _check_reach(self) -> None:
        # Not even with all of the mass in the farthest part.
        largest = self.mass * self._reach**2
        moment = float(np.linalg.eigvalsh(self.inertia_matrix)[-1])
        if moment > largest:
            raise ConfigError(
                f'drone: inertia = {list(self.inertia)} has the principal moment {moment:.3g} '
                f'kg m^2, but {self.mass:g} kg within body and rotors have at most {largest:.3g}: '
                'check the unit, kg m^2, and mass, size and rotors'
            )

    def _check_on_body(self, key: str, place: tuple[float, ...]) -> None:
        if any(abs(x) > 0.5 * length + _EDGE for x, length in zip(place, self.size, strict=True)):
            raise ConfigError(
                f'drone: {key} at {list(place)} m is not on the body, whose size is '
                f'{list(self.size)} m about its frame: check both'
            )

    def _check_rotors(self) -> None:
        if not self.rotors:
            raise ConfigError('drone: rotors is empty: a drone has at least four')
        for name in self.rotor_names:
            if self.rotor_names.count(name) > 1:
                raise ConfigError(f'drone: rotor {name} is given twice')
        # Thrust along z and three moments are what it takes to hover.
        matrix = self.allocation[2:]
        matrix[1:] /= self._arm_length
        if np.linalg.matrix_rank(matrix, tol=1e-4) < 4:
            raise ConfigError(
                'drone: thrust and the three moments cannot be chosen each by itself with these '
                'rotors: check their positions, axes and the signs of moment_per_thrust'
            )
        share = self._liftable_share(self.mass, np.array(self.centre_of_mass))
        if share < THRUST_RESERVE:
            raise ConfigError(
                f'drone: its rotors lift {share:.2f} times its weight ({self.mass:g} kg) while it '
                f'is level, and must lift {THRUST_RESERVE:g} times it: check thrust_max, '
                'thrust_min and mass'
            )


def load_drone_config(path: Path | str | None = None) -> DroneConfig:
    """Read a drone.

    Parameters
    ----------
    path : Path or str, optional
        YAML file laid out as the packaged config/drone.yaml, which is the default.

    Raises
    ------
    ConfigError
        If the file can't be read or says something wrong; one line, with file and key.
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
        # The pose does not know whose it is.
        raise ConfigError(str(error).replace('pose:', f'{where}:', 1)) from None
