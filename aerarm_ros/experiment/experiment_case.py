"""What the experiment tries: one law, what it knows, and what the drone does."""

from dataclasses import dataclass, replace

from aerarm_ros.simulation.base_profile import MOVING, STILL, TILTED

GRAVITY, HOST, BOARDS = 'gravity compensation', 'computed torque, host', 'computed torque, boards'
CAD, TRUE = 'CAD', 'true'


@dataclass(frozen=True)
class ExperimentCase:
    """One run.

    Attributes
    ----------
    law
        `GRAVITY`, `HOST` or `BOARDS`.
    parameters
        Parameters that the controller knows: `CAD`, or `TRUE`, which are the plant's own.
    observer
        Whether the momentum observer compensates.
    base
        What the drone does: `STILL`, `TILTED` or `MOVING`.
    aware
        Whether the controller listens to the IMU.
    """

    law: str
    parameters: str
    observer: bool = False
    base: str = STILL
    aware: bool = False

    @property
    def name(self) -> str:
        """Description for tables."""
        observer = ' + observer' if self.observer else ''
        imu = '' if self.base == STILL else ', IMU' if self.aware else ', no IMU'
        return f'{self.law}{observer}; {self.parameters}; {self.base}{imu}'


def all_cases() -> list[ExperimentCase]:
    """Return the runs of the experiment."""
    still = [
        ExperimentCase(law, parameters, observer)
        for law in (GRAVITY, HOST, BOARDS)
        for parameters in (CAD, TRUE)
        for observer in (False, True)
    ]
    host, cad = ExperimentCase(HOST, TRUE), ExperimentCase(HOST, CAD)
    compared = [host, ExperimentCase(BOARDS, TRUE), cad, replace(cad, observer=True)]
    moved = [
        replace(case, base=base, aware=aware)
        for base in (TILTED, MOVING)
        for case in compared
        for aware in (False, True)
    ]
    return [*still, *moved]
