"""Methods to compensate the arm's motion in the flight controller."""

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
