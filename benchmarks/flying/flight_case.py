"""Flight case: drone, controller settings and model errors."""

from dataclasses import dataclass, field, replace

from aerarm_ros.description.drone_config import DroneConfig

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
