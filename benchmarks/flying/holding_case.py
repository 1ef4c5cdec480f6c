"""Cases of an arm that holds its tool in the world or presses it on a wall, with their goals."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from flying.flight_case import load_drone, scaled_drone

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.model.kinematics import Kinematics

POSTURE = 0.0, 1.3, 0.0, 1.5
TOOL = 0.1, 0.0, 0.0  # [m] in the last joint's frame
WIND, WIND_CUTOFF = 1.5, 0.5  # [N] RMS of the total force, [Hz]
GENERALISED, ORDINARY, HELD = 'generalised Jacobian', 'ordinary Jacobian', 'joints held'
_RATE, _DELAY = 'external_odometry_rate', 'external_odometry_delay'
_NOISE = 'external_odometry_noise'
GOOD: Mapping[str, object] = MappingProxyType(
    {_RATE: 100.0, _DELAY: 0.01, _NOISE: [1e-3, 5e-3, 0.0, 0.0]}
)
POOR: Mapping[str, object] = MappingProxyType(
    {_RATE: 30.0, _DELAY: 0.03, _NOISE: [5e-3, 20e-3, 0.0, 0.0]}
)
SENSORS: Mapping[str, object] = MappingProxyType(
    {
        'imu_delay': 4e-3,
        'imu_noise': [0.05, 0.003],
        'imu_bias': [0.05, 0.002],
        'odometry_delay': 4e-3,
        'odometry_noise': [1e-3, 5e-3, 0.0, 0.0],
    }
)
_INTEGRAL = {'position_integral': 0.1, 'attitude_integral': 0.1}
# With an arm that holds its tool, a drone rotates more easily than with held joints. These gains
# are stable in both cases, see docs/how-to/world.md. A stiff height keeps the tool in reach,
# because the arm reaches least along its own direction.
_COPLANAR, _FULL = (2.5, 4.5, 8.0), (8.67, 8.67, 9.0)
_LIGHTEST = 2.5  # [kg] below which the arm needs the gains for light drones


@dataclass(frozen=True)
class HoldingCase:
    """Settings of one flight in which the arm holds its tool in the world.

    Attributes
    ----------
    goal : float
        Goal for the RMS tool error [mm]; infinite for none.
    mass : float
        Mass of the drone [kg]; 0 for that of the file.
    drone : str
        Key of `flight_way.DRONES`.
    law : str
        GENERALISED, ORDINARY or HELD.
    odometry : mapping
        Parameters of the odometry for the arm's controller.
    wrong : float
        Relative error of every link in the model.
    path : bool
        Whether the tool follows a path of 20 cm at 0.25 Hz.
    payload : float
        Mass of a known payload at the tool [kg].
    """

    goal: float = float('inf')
    mass: float = 0.0
    drone: str = 'hexarotor'
    law: str = GENERALISED
    odometry: Mapping[str, object] = field(default_factory=lambda: GOOD)
    wrong: float = 0.0
    path: bool = False
    payload: float = 0.0

    @property
    def flown(self) -> DroneConfig:
        """Drone of this case."""
        return scaled_drone(self.mass) if self.mass else load_drone(self.drone)

    @property
    def is_light(self) -> bool:
        """Whether the arm needs the gains for light drones."""
        return self.flown.mass < _LIGHTEST

    @property
    def law_gains(self) -> dict[str, object]:
        """Gains of `world_control`, if other than the default ones."""
        return {'kp': 144.0, 'kd': 24.0} if self.is_light else {}

    @property
    def pilot(self) -> dict[str, object]:
        """Parameters of `flight_control`."""
        drone = self.flown
        gains = _FULL if drone.is_fully_actuated else _COPLANAR
        names = 'position_frequency', 'height_frequency', 'attitude_frequency'
        return {**dict(zip(names, gains, strict=True)), **_INTEGRAL}

    @property
    def world(self) -> dict[str, object]:
        """Parameters of `fake_hardware` except those of the arm and the drone file."""
        wind = {'gust_force': WIND / float(np.sqrt(3.0)), 'gust_cutoff': WIND_CUTOFF}
        return {
            'pace': 'lockstep',
            'encoders': 'absolute',
            'initial_position': list(POSTURE),
            **wind,
            **SENSORS,
            **self.odometry,
            'payload': [self.payload, *TOOL] if self.payload else [],
        }

    @property
    def carried(self) -> dict[str, object]:
        """Parameters of a node that knows the payload."""
        if not self.payload:
            return {}
        body = parameters_of_body(self.payload, TOOL, np.zeros((3, 3)))
        return {'payload.inertial_parameters': body.tolist()}


CASES = {
    'tool at rest': HoldingCase(2.5),
    'tool on a path': HoldingCase(3.0, path=True),
    'poor odometry': HoldingCase(5.0, odometry=POOR),
    'payload of 0.2 kg': HoldingCase(2.5, payload=0.2),
    'drone of 2 kg': HoldingCase(4.0, mass=2.0),
    'drone of 1.5 kg': HoldingCase(4.0, mass=1.5),
    'fully actuated': HoldingCase(1.5, drone='tilted_hexarotor'),
    'links 10 % wrong': HoldingCase(3.75, wrong=0.1),
    'ordinary Jacobian': HoldingCase(law=ORDINARY),
    'joints held': HoldingCase(law=HELD),
}
"""Cases by name, with goals for the RMS error [mm]; 1.5 times the first goal for wrong links."""

FULL = 'tilted_hexarotor'


@dataclass(frozen=True)
class PushingCase(HoldingCase):
    """Settings of one flight with a wall ahead of the tool, in the direction x.

    Attributes
    ----------
    goal : float
        Goal for the RMS force error [N], or for the distance of the stop [mm] if the wall yields.
    force : float
        Set force on the wall [N].
    stiffness : float
        Stiffness of the wall [N/m].
    gap : float
        Distance of the wall from the tool at the start [m].
    calm : bool
        Whether there is no wind.
    yields_after, yield_speed : float
        Time after the first touch at which the wall moves away [s], and its speed [m/s]; 0 for
        never, and for a wall that disappears.
    """

    force: float = 5.0
    stiffness: float = 1e4
    gap: float = 0.03
    calm: bool = False
    yields_after: float = 0.0
    yield_speed: float = 0.0

    @property
    def world(self) -> dict[str, object]:
        """Parameters of `fake_hardware` with the wall."""
        drone = self.flown
        kinematics = Kinematics(load_robot(gravity_in_base=drone.gravity_in_base))
        tool = drone.mount.rotation @ kinematics.position(np.array(POSTURE)) + drone.mount.position
        wall = {
            'wall': [float(tool[0] + self.gap), 0.0, 0.0, 1.0, 0.0, 0.0],
            'wall_stiffness': self.stiffness,
            'wall_yields_after': self.yields_after,
            'wall_yield_speed': self.yield_speed,
        }
        calm = {'gust_force': 0.0} if self.calm else {}
        return {**super().world, **wall, **calm}


PUSHES = {
    'push, 1e3 N/m': PushingCase(0.5, drone=FULL, stiffness=1e3),
    'push, 1e4 N/m': PushingCase(0.5, drone=FULL),
    'push and slide, 1e3 N/m': PushingCase(0.5, drone=FULL, stiffness=1e3, path=True),
    'push and slide, 1e4 N/m': PushingCase(0.5, drone=FULL, path=True),
    'coplanar, no wind, 2 N': PushingCase(force=2.0, gap=0.06, calm=True),
    'coplanar, no wind, 5 N': PushingCase(gap=0.06, calm=True),
    'loss of contact': PushingCase(20.0, drone=FULL, yields_after=4.0),
    'slipping wall, 0.05 m/s': PushingCase(20.0, drone=FULL, yields_after=4.0, yield_speed=0.05),
}
"""Cases by name: wind as in `holding_case`, fully actuated drone and 5 N unless stated."""
