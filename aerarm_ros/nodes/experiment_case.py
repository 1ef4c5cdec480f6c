"""What the experiment tries: one law, what it knows, and what the drone does."""

from dataclasses import dataclass, replace

import numpy as np

from aerarm_ros.simulation.base_profile import BaseProfile

GRAVITY, HOST, BOARDS = 'gravity compensation', 'computed torque, host', 'computed torque, boards'
CAD, IDENTIFIED = 'CAD', 'identified'
STILL, TILTED, MOVING = 'still', 'tilted', 'moving'

BASES = {
    STILL: BaseProfile(),
    TILTED: BaseProfile(axis=np.array([0.8, 0.6, 0.0]), tilt=np.radians(20.0)),
    # 30 degrees at 0.5 Hz about the roll axis, with a sway.
    MOVING: BaseProfile(swing=np.radians(30.0), shift=np.array([0.1, 0.15, 0.1])),
}


@dataclass(frozen=True)
class ExperimentCase:
    """One run.

    Attributes
    ----------
    law
        `GRAVITY`, `HOST` or `BOARDS`.
    parameters
        Model of the controller: `CAD` or `IDENTIFIED`, the latter being the plant's.
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
        for parameters in (CAD, IDENTIFIED)
        for observer in (False, True)
    ]
    host = ExperimentCase(HOST, IDENTIFIED)
    boards = ExperimentCase(BOARDS, IDENTIFIED)
    cad = ExperimentCase(HOST, CAD, observer=True)
    moved = [
        replace(case, base=base, aware=aware)
        for base in (TILTED, MOVING)
        for case in (host, boards)
        for aware in (False, True)
    ]
    return [*still, *moved, replace(cad, base=MOVING, aware=True)]
