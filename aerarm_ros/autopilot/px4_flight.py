"""A drone under PX4's loops, with a set point that takes an acceleration with it."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.autopilot.px4_frames import frd_rotation, heading, ned
from aerarm_ros.autopilot.px4_gains import Px4Gains
from aerarm_ros.autopilot.px4_loops import Px4Loops, Px4SetPoint, Px4State
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.frame_conversion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.allocation import Allocation
from aerarm_ros.flight.feed_forward import FeedForward
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.flight_target import FlightTarget, yaw_of
from aerarm_ros.flight.mass_properties import MassProperties

Array = npt.NDArray[np.float64]

_SINK = 0.97  # share of the weight that is lifted where the height is not known


class Px4Flight:
    """`Px4Loops` on a drone's rotors, used as a `FlightControl`.

    All that reaches the loops of the arm is the acceleration of a set point: neither its weight's
    moment nor its inertia. The hover thrust is that of drone and arm at rest.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm at rest.
    gains : Px4Gains
    knows_loops : bool
        Whether the loops' gains serve to lean ahead.
    holds_heading : bool
        Whether set points have a heading; else it is left to itself.

    Attributes
    ----------
    problem : str
        As a `FlightControl` has it.
    """

    problem = ''

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        gains: Px4Gains,
        knows_loops: bool = True,
        holds_heading: bool = True,
    ) -> None:
        self._holds_heading = holds_heading
        self._allocation = Allocation(drone)
        most = drone.column('thrust_max')
        matrix = np.abs(self._allocation.matrix)
        self._thrust_max = float(matrix[2] @ most)
        # With one half of the rotors at their largest thrust.
        self._moment_max = 0.5 * matrix[3:] @ most
        self._body = body
        self._loops = Px4Loops(gains, body.mass * GRAVITY / self._thrust_max)
        self._acceleration = SetPointAcceleration()
        if knows_loops:
            rate_gain = gains.mc_rate_k * gains.mc_rate_p * float(self._moment_max[:2].mean())
            lasting = gains.mc_rate_i / gains.mc_rate_p
            self._acceleration = SetPointAcceleration(gains.mc_att_p, rate_gain, lasting)

    def reset(self) -> None:
        """Forget integrals."""
        self._loops.reset()

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the thrusts (n,) [N] that lead to the target, after a step of `dt` [s]."""
        wanted = target.acceleration
        if arm is not None:
            wanted = wanted + self._acceleration.update(arm, state.rotation, dt)
        yaw = heading(target.yaw) if self._holds_heading else np.nan
        set_point = Px4SetPoint(ned(target.position), yaw, ned(target.velocity), ned(wanted))
        return self._thrusts(state, set_point, dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return the thrusts (n,) [N] of a drone that knows its attitude only: level, sinking."""
        sinking = np.array([0.0, 0.0, (1.0 - _SINK) * GRAVITY])
        here = Px4SetPoint(
            ned(state.position), heading(yaw_of(state.rotation)), np.zeros(3), sinking
        )
        return self._thrusts(state, here, dt)

    def _thrusts(self, state: FlightState, wanted: Px4SetPoint, dt: float) -> Array:
        vehicle = Px4State(
            ned(state.position),
            ned(state.velocity),
            frd_rotation(state.rotation),
            frd_to_flu(state.rate),
        )
        thrust, moment = self._loops.update(vehicle, wanted, dt)
        force = np.array([0.0, 0.0, thrust * self._thrust_max])
        wrench = np.concatenate([force, frd_to_flu(moment * self._moment_max)])
        return self._allocation.thrusts(wrench)
