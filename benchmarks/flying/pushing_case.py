"""Cases of an arm that presses its tool on a wall, with their goals."""

from dataclasses import dataclass

import numpy as np
from flying.holding_case import POSTURE, HoldingCase

from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics

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
