"""What is flown, what the controller makes of it, and what is wrong."""

from dataclasses import dataclass, field, replace

from aerarm_ros.description.drone_config import DroneConfig

CHEAP = (
    ('imu_noise', [0.3, 0.01]),
    ('imu_bias', [0.2, 0.01]),
    ('imu_attitude_error', 0.01),
)
LATE = (('imu_delay', 0.01),)


@dataclass(frozen=True)
class FlightCase:
    """One set of processes.

    Attributes
    ----------
    mass : float
        Of the drone [kg]; 0 for a fixed base.
    base : str
        The controller's `base_motion`.
    wrong : str
        What is wrong.
    believed : float
        The controllers' mass and inertia of the drone over the true ones.
    sensors : tuple of pairs
        Parameters of the emulated sensors.
    hears_rotors : bool
        Whether the controller is told what the rotors are.
    drone : DroneConfig, optional
        Another one than that of `mass`.
    flight : tuple of pairs
        Parameters of the flight controller.
    is_told : bool
        Whether the drone is told of its arm, to feed it forward.
    ahead : float
        How far ahead of time it is told [s].
    told : tuple of pairs
        Other parameters of who tells it.
    is_touched : bool
        Whether that looks for contact besides.
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
        """Return the same with what may be wrong, one after the other and together."""
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
