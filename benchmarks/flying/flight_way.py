"""The ways in which a drone may bear its arm's motion."""

from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource

DRONES = {'tilted_hexarotor': ('drones', 'tilted_hexarotor.yaml'), 'hexarotor': ('drone.yaml',)}
GAINS = Path(__file__).with_name('gains.yaml')
_LEAD, _LEAD_MAX = 0.028, 0.08  # [s]
_HEIGHT = 3.0  # [rad/s]
_NO_PARAMETERS = 'integral', 'position RMS [mm]'


@dataclass(frozen=True)
class FlightWay:
    """What finds out forces that nobody told of, and what is told.

    Attributes
    ----------
    gains : str
        Which of the gains of `GAINS`.
    rejection : str
        As `flight_control` has it.
    posture, motion : bool
    lead : float
        What is fed forward, and how far ahead [s].
    """

    gains: str
    rejection: str = 'integral'
    posture: bool = False
    motion: bool = False
    lead: float = 0.0

    @property
    def is_told(self) -> bool:
        """Whether anything is told."""
        return self.posture or self.motion

    @property
    def switches(self) -> dict[str, object]:
        """Parameters of `flight_control` that may be changed in flight."""
        return {'feed_posture': self.posture, 'feed_motion': self.motion, 'feed_lead': self.lead}

    def later(self, latency: float) -> 'FlightWay':
        """Return the same for sensors that are late [s], whose stamps are as old."""
        return replace(self, lead=min(self.lead + latency, _LEAD_MAX)) if self.lead else self

    def parameters(self, drone: str) -> dict[str, object]:
        """Return all parameters of `flight_control` but the drone."""
        tuned = yaml.safe_load(GAINS.read_text())[f'{drone}/{self.gains}']
        gains = {name: value for name, value in tuned.items() if name not in _NO_PARAMETERS}
        if 'integral' in tuned:
            gains.update(position_integral=tuned['integral'], attitude_integral=tuned['integral'])
        if 'position_frequency' in gains:
            height = height_frequency(load_drone(drone), gains['position_frequency'])
            gains['height_frequency'] = height
        loops = 'px4' if self.gains.startswith('px4') else 'own'
        return {**gains, 'loops': loops, 'rejection': self.rejection, **self.switches}


WAYS = {
    'integral': FlightWay('integral'),
    'observer': FlightWay('observer', 'observer'),
    'INDI': FlightWay('indi', 'indi'),
    'posture': FlightWay('feed_forward', posture=True),
    'posture, motion': FlightWay('feed_forward', posture=True, motion=True),
    'posture, motion, lead': FlightWay('feed_forward', posture=True, motion=True, lead=_LEAD),
    "PX4's loops": FlightWay('px4'),
    "PX4's loops, acceleration": FlightWay(
        'px4_feed_forward', posture=True, motion=True, lead=_LEAD
    ),
}


def ways_of(drone: str) -> list[str]:
    """Return the ways for which there are gains of a drone."""
    tuned = yaml.safe_load(GAINS.read_text())
    return [name for name, way in WAYS.items() if f'{drone}/{way.gains}' in tuned]


def height_frequency(drone: DroneConfig, position_frequency: float) -> float:
    """Return how stiffly all ways hold the height [rad/s]: lift waits for no lean."""
    return position_frequency if drone.is_fully_actuated else _HEIGHT


def load_drone(name: str) -> DroneConfig:
    """Return one of `DRONES`."""
    return load_drone_config(resource('config', *DRONES[name]))
