"""ROS parameters of the emulated drone, and functions that create its sensors, wind and wall."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.simulation.flying_plant import FlyingPlant, FreeBasePlant
from aerarm_ros.simulation.sensors import (
    BandLimitedNoise,
    DelayedSensor,
    FaultyImu,
    ImuReading,
    NoisyOdometry,
    OdometryReading,
    RandomDrift,
)
from aerarm_ros.simulation.wall import Wall, WallParameters

_GUST_PERIOD = 1e-3  # [s]
_TRUE_RATE = 250.0  # [Hz]
_IMU_SEED, _ODOMETRY_SEED, _GUST_SEED, _EXTERNAL_SEED = range(4)

CONTACT = 'contact_force', 'contact_link'


def _delay(sensor: str, text: str) -> Parameter:
    return Parameter(f'{sensor}_delay', 0.0, text, 's', 0.0, 0.5)


def _deviations(name: str, text: str, units: str) -> Parameter:
    """Return the parameter of several standard deviations, one per unit, by default zero."""
    return Parameter(name, [0.0] * len(units.split(',')), text, units, 0.0, 10.0)


DRONE_PARAMETERS = grouped(
    'Emulated drone',
    Parameter(
        'rotor_timeout',
        0.2,
        'age of the newest rotor command, in simulated time, above which the rotors of the '
        'emulated drone stop',
        's',
        0.005,
        10.0,
    ),
    Parameter(
        'imu_rate',
        250.0,
        "sampling rate of the emulated IMU on the drone or on the arm's moving base",
        'Hz',
        1,
        1000,
    ),
    _delay('imu', 'delay from the sampling of the emulated IMU to the publication of the sample'),
    _deviations(
        'imu_noise',
        'noise of the emulated IMU: standard deviations for specific force and for angular '
        'velocity',
        'm/s^2, rad/s',
    ),
    _deviations(
        'imu_bias',
        'standard deviations of the random constant bias of the emulated IMU, per axis: for '
        'specific force and for angular velocity',
        'm/s^2, rad/s',
    ),
    Parameter(
        'imu_attitude_error',
        0.0,
        "standard deviation of the emulated IMU's attitude error, which has a correlation time of "
        'about 10 s',
        'rad',
        0.0,
        1.0,
    ),
    Parameter(
        'odometry_rate', 250.0, "publishing rate of the emulated drone's odometry", 'Hz', 1, 1000
    ),
    _delay(
        'odometry', "delay from the measurement of the emulated drone's odometry to its publication"
    ),
    _deviations(
        'odometry_noise',
        "noise of the emulated drone's odometry: standard deviations of position, velocity, "
        'attitude and angular velocity',
        'm, m/s, rad, rad/s',
    ),
    Parameter(
        'external_odometry_rate',
        0.0,
        'publishing rate of external_odometry, as measured by an emulated camera or motion '
        'capture that observes the drone; 0 for none',
        'Hz',
        0.0,
        1000.0,
    ),
    _delay(
        'external_odometry', 'delay from the measurement of external_odometry to its publication'
    ),
    _deviations(
        'external_odometry_noise',
        'noise of external_odometry: standard deviations of position, velocity, attitude and '
        'angular velocity',
        'm, m/s, rad, rad/s',
    ),
    Parameter(
        'gust_force',
        0.0,
        'standard deviation of the random wind force on the drone, per axis',
        'N',
        0.0,
        1e3,
    ),
    Parameter('gust_time', 1.0, 'correlation time of the random wind force', 's', 0.01, 100.0),
    Parameter(
        'gust_cutoff',
        0.0,
        'bandwidth of a second-order spectrum of the wind force, which replaces gust_time; 0 to '
        'use gust_time',
        'Hz',
        0.0,
        100.0,
    ),
    Parameter(
        'contact_force',
        [],
        'external force on the drone or its arm: x, y, z in world axes, at the origin of '
        'contact_link; no force if empty',
        'N',
        -1000.0,
        1000.0,
        element=float,
        live=True,
    ),
    Parameter(
        'contact_link',
        '',
        'link of the URDF on which contact_force acts, for example tool0; if empty, the force acts '
        "on the drone's body",
        live=True,
    ),
    Parameter(
        'wall',
        [],
        'compliant wall that the link tool0 can touch: x, y, z of a point on the wall and x, y, z '
        'of the direction into the wall, in world axes; no wall if empty',
        'm',
        -1000.0,
        1000.0,
        element=float,
    ),
    Parameter('wall_stiffness', 1e4, 'contact stiffness of the compliant wall', 'N/m', 1.0, 1e5),
    Parameter('wall_damping', 10.0, 'contact damping of the compliant wall', 'Ns/m', 0.0, 1000.0),
    Parameter('wall_friction', 0.3, 'coefficient of friction between tool and wall', '', 0.0, 2.0),
    Parameter(
        'wall_yields_after',
        0.0,
        'time from the first contact until the wall moves away from the tool; 0 for never',
        's',
        0.0,
        1e4,
    ),
    Parameter(
        'wall_yield_speed',
        0.0,
        'speed at which the wall moves away from the tool; 0 for a wall that disappears at once',
        'm/s',
        0.0,
        100.0,
    ),
)


def imu(values: SimpleNamespace, plant: FreeBasePlant) -> DelayedSensor[ImuReading]:
    """Create the emulated IMU from parameters; raise ValueError for invalid parameters."""
    noise, bias = _numbers(values, 'imu_noise', 2), _numbers(values, 'imu_bias', 2)
    errors = noise[0], noise[1], bias[0], bias[1], values.imu_attitude_error
    faulty = FaultyImu(1.0 / values.imu_rate, _seed(values, _IMU_SEED), *errors)
    return DelayedSensor(
        lambda: faulty.apply(plant.imu), values.imu_rate, values.period, values.imu_delay
    )


def odometry(
    values: SimpleNamespace, plant: FlyingPlant, name: str = 'odometry', seed: int = _ODOMETRY_SEED
) -> DelayedSensor[OdometryReading]:
    """Create the odometry sensor of a topic; raise ValueError for invalid parameters."""
    noisy = NoisyOdometry(_seed(values, seed), _numbers(values, f'{name}_noise', 4))
    rate, delay = getattr(values, f'{name}_rate'), getattr(values, f'{name}_delay')
    return DelayedSensor(lambda: noisy.apply(plant.odometry), rate, values.period, delay)


def other_odometry(
    values: SimpleNamespace, plant: FlyingPlant
) -> list[tuple[Topic, DelayedSensor[OdometryReading]]]:
    """Return pairs of topic and sensor: true odometry and, if enabled, external odometry."""
    true = DelayedSensor(lambda: plant.odometry, _TRUE_RATE, values.period)
    found = [(topics.TRUE_ODOMETRY, true)]
    if values.external_odometry_rate:
        external = odometry(values, plant, 'external_odometry', _EXTERNAL_SEED)
        found.append((topics.EXTERNAL_ODOMETRY, external))
    return found


def gust(values: SimpleNamespace) -> RandomDrift | BandLimitedNoise | None:
    """Create the random wind force from parameters; return None if gust_force is zero."""
    if values.gust_force == 0.0:
        return None
    random = np.random.default_rng(_seed(values, _GUST_SEED))
    if values.gust_cutoff:
        return BandLimitedNoise(values.gust_force, values.gust_cutoff, _GUST_PERIOD, random)
    return RandomDrift(values.gust_force, values.gust_time, _GUST_PERIOD, random)


def contact(values: SimpleNamespace, plant: FlyingPlant) -> tuple[list[float], str]:
    """Return contact_force [N] and contact_link; raise ValueError for invalid parameters."""
    force = _numbers(values, 'contact_force', 3) if values.contact_force else [0.0, 0.0, 0.0]
    plant.place_on(values.contact_link)
    return force, values.contact_link


def wall(values: SimpleNamespace) -> Wall | None:
    """Create the wall from parameters, None without wall; raise ValueError if one is invalid."""
    if not values.wall:
        return None
    place = _numbers(values, 'wall', 6)
    contact = values.wall_stiffness, values.wall_damping, values.wall_friction
    yields = values.wall_yields_after or np.inf, values.wall_yield_speed or np.inf
    return Wall(WallParameters(tuple(place[:3]), tuple(place[3:]), *contact, *yields))


def _numbers(values: SimpleNamespace, name: str, count: int) -> list[float]:
    numbers: list[float] = list(getattr(values, name))
    if len(numbers) != count:
        raise ValueError(
            f'the parameter {name} has {len(numbers)} numbers instead of {count}: see the '
            f'description of {name} in --help'
        )
    return numbers


def _seed(values: SimpleNamespace, which: int) -> int:
    return int(10 * max(values.seed, 0) + which)
