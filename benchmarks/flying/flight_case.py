"""Cases of flights: drones, methods to compensate the arm's motion, and model errors."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import yaml

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot

DRONES = {'tilted_hexarotor': ('drones', 'tilted_hexarotor.yaml'), 'hexarotor': ('drone.yaml',)}
GAINS = Path(__file__).with_name('gains.yaml')
_LEAD, _LEAD_MAX = 0.028, 0.08  # [s]
_HEIGHT = 3.0  # [rad/s]
_NO_PARAMETERS = 'integral', 'position RMS [mm]'


@dataclass(frozen=True)
class FlightWay:
    """Disturbance estimation and feed-forward of one method.

    Attributes
    ----------
    gains : str
        Key of the gains in `GAINS`.
    law : str
        Law of `compared_flight`; empty for that of `flight_control`.
    posture, motion : bool
        Whether the effect of the arm's posture, and of its motion, is fed forward.
    lead : float
        Preview time of the feed-forward [s].
    """

    gains: str
    law: str = ''
    posture: bool = False
    motion: bool = False
    lead: float = 0.0

    @property
    def is_told(self) -> bool:
        """Whether any feed-forward is used."""
        return self.posture or self.motion

    @property
    def switches(self) -> dict[str, object]:
        """Parameters of `flight_control` that can be changed in flight."""
        return {'feed_posture': self.posture, 'feed_motion': self.motion, 'feed_lead': self.lead}

    def later(self, latency: float) -> 'FlightWay':
        """Return the method for sensors with a delay [s] that their stamps include."""
        return replace(self, lead=min(self.lead + latency, _LEAD_MAX)) if self.lead else self

    def parameters(self, drone: str) -> dict[str, object]:
        """Return all parameters of `flight_control` except the drone."""
        tuned = yaml.safe_load(GAINS.read_text())[f'{drone}/{self.gains}']
        gains = {name: value for name, value in tuned.items() if name not in _NO_PARAMETERS}
        if 'integral' in tuned:
            gains.update(position_integral=tuned['integral'], attitude_integral=tuned['integral'])
        if 'position_frequency' in gains:
            height = height_frequency(load_drone(drone), gains['position_frequency'])
            gains['height_frequency'] = height
        law = {'law': self.law} if self.law else {}
        return {**gains, **law, **self.switches}


WAYS = {
    'integral': FlightWay('integral'),
    'observer': FlightWay('observer', 'observer'),
    'INDI': FlightWay('indi', 'indi'),
    'posture': FlightWay('feed_forward', posture=True),
    'posture, motion': FlightWay('feed_forward', posture=True, motion=True),
    'posture, motion, lead': FlightWay('feed_forward', posture=True, motion=True, lead=_LEAD),
    "PX4's loops": FlightWay('px4', 'px4'),
    "PX4's loops, acceleration": FlightWay(
        'px4_feed_forward', 'px4', posture=True, motion=True, lead=_LEAD
    ),
}


def ways_of(drone: str) -> list[str]:
    """Return the methods with gains for a drone."""
    tuned = yaml.safe_load(GAINS.read_text())
    return [name for name, way in WAYS.items() if f'{drone}/{way.gains}' in tuned]


def height_frequency(drone: DroneConfig, position_frequency: float) -> float:
    """Return the height frequency of all methods [rad/s]; lift needs no tilt."""
    return position_frequency if drone.is_fully_actuated else _HEIGHT


def load_drone(name: str) -> DroneConfig:
    """Return one of the drones in `DRONES`."""
    return load_drone_config(resource('config', *DRONES[name]))


def scaled_drone(mass: float) -> DroneConfig:
    """Return a drone of a mass [kg]: the quadrotor up to 1.5 kg, otherwise the hexarotor.

    Lengths are constant, inertia is proportional to mass^(5/3), and thrust is proportional to the
    weight of drone and arm.
    """
    name = ('drones', 'quadrotor.yaml') if mass < 1.5 else ('drone.yaml',)
    drone = load_drone_config(resource('config', *name))
    arm = float(load_robot().inertial_parameters[:, 0].sum())
    thrust = (mass + arm) / (drone.mass + arm)
    rotors = tuple(replace(r, thrust_max=thrust * r.thrust_max) for r in drone.rotors)
    # Rotors first, because each intermediate drone must be able to fly.
    strong = replace(drone, rotors=rotors)
    return strong.with_errors(mass / drone.mass, (mass / drone.mass) ** (5 / 3))


def write_drone(drone: DroneConfig, path: Path) -> Path:
    """Write a drone configuration file."""
    path.write_text(yaml.safe_dump(json.loads(json.dumps(asdict(drone)))))
    return path


CHEAP = (('imu_noise', [0.3, 0.01]), ('imu_bias', [0.2, 0.01]), ('imu_attitude_error', 0.01))
LATE = (('imu_delay', 0.01),)


@dataclass(frozen=True)
class FlightCase:
    """Settings of the processes of one flight.

    Attributes
    ----------
    mass : float
        Mass of the drone [kg]; 0 for a fixed base.
    base : str
        Parameter `base_motion` of the controller.
    wrong : str
        Description of the model error.
    believed : float
        Ratio of modelled to true mass and inertia of the drone.
    sensors : tuple of pairs
        Parameters of the emulated sensors.
    hears_rotors : bool
        Whether the controller receives the rotor commands.
    drone : DroneConfig, optional
        Drone that replaces the one of `mass`.
    flight : tuple of pairs
        Parameters of the flight controller.
    is_told : bool
        Whether the flight controller receives the arm's reaction, for feed-forward.
    ahead : float
        Preview time of that reaction [s].
    told : tuple of pairs
        Further parameters of the node that publishes the reaction.
    is_touched : bool
        Whether that node also estimates contact forces.
    law : tuple of pairs
        Parameters of the arm's controller.
    """

    mass: float
    base: str
    wrong: str = 'nothing'
    believed: float = 1.0
    sensors: tuple[tuple[str, object], ...] = field(default=(), hash=False)
    hears_rotors: bool = True
    drone: DroneConfig | None = None
    flight: tuple[tuple[str, object], ...] = field(default=(), hash=False)
    is_told: bool = False
    ahead: float = 0.06
    told: tuple[tuple[str, object], ...] = field(default=(), hash=False)
    is_touched: bool = True
    law: tuple[tuple[str, object], ...] = field(default=(), hash=False)

    def variants(self) -> list['FlightCase']:
        """Return the cases with each model error alone, and with all of them."""
        return [
            replace(self, wrong='mass 20 % too large', believed=1.2),
            replace(self, wrong='mass 20 % too small', believed=0.8),
            replace(self, wrong='cheap IMU', sensors=CHEAP),
            replace(self, wrong='IMU 10 ms late', sensors=LATE),
            replace(self, wrong='all but the commands', believed=1.2, sensors=CHEAP + LATE),
            replace(self, wrong='no rotor commands', hears_rotors=False),
            replace(
                self,
                wrong='all, no rotor commands',
                believed=1.2,
                sensors=CHEAP + LATE,
                hears_rotors=False,
            ),
        ]
