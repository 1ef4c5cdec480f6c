"""Forces on drone and arm that nobody has told of, from the momentum of both."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import positive
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.model.cross_product import cross
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics

Array = npt.NDArray[np.float64]

_WEIGHT = np.array([0.0, 0.0, -GRAVITY])


class ContactObserver:
    """Compares the momentum of drone and arm with what rotors and weight have made of it.

    With p and L the linear momentum and the angular one about the centre of mass c of the whole,
    joints included, in the world::

        dp/dt = f + m g + f_c          dL/dt = M - c x f + M_c

    The joints' torques act between parts of the whole and are not in it, so the arm moves as it
    likes; neither is any acceleration. What remains passes a first-order low-pass, which makes of
    it the observer `d = K (p - int(f + m g + d) dt)` (De Luca et al., IROS 2006, of a free body).

    Parameters
    ----------
    drone : DroneConfig
        For where the arm's base is on it.
    whole : WholeBodyDynamics
        Arm and drone, an instance of its own, to be told of a payload.
    bandwidth : float
        Of the low-pass [Hz].

    Attributes
    ----------
    bandwidth : float
        May be changed.

    Raises
    ------
    ValueError
        If the bandwidth isn't positive.
    """

    def __init__(self, drone: DroneConfig, whole: WholeBodyDynamics, bandwidth: float) -> None:
        self.bandwidth = positive('contact_bandwidth', bandwidth)
        self.whole = whole
        self._mount = np.array(drone.mount.position)
        self._turn = drone.mount.rotation
        self.reset()

    def reset(self) -> None:
        """Begin anew, with no contact."""
        self._estimate = np.zeros(6)
        self.pause()

    def pause(self) -> None:
        """Keep the estimate, and take the next motion as it is: what went before was not seen."""
        self._before: tuple[Array, Array, Array] | None = None

    def update(self, state: FlightState, q: Array, dq: Array, rotors: Array, dt: float) -> Array:
        """Return the wrench of the contact, low-passed.

        Parameters
        ----------
        state : FlightState
            Of the drone.
        q, dq : (n,) ndarray
            Of the joints at the same time [rad], [rad/s].
        rotors : (6,) ndarray
            Mean wrench of the rotors over the last `dt`.
        dt : float
            Since the last call [s], positive.

        Returns
        -------
        (6,) ndarray
            On drone and arm: force [N] and moment [Nm] about the origin of the arm's base frame, in
            its axes, as is `rotors`.
        """
        rotation = state.rotation @ self._turn
        momentum, centre = self._momentum(state, q, dq, rotation)
        before, self._before = self._before, (momentum, rotation, centre)
        if before is not None:
            last, last_rotation, last_centre = before
            # The mean of both ends is of second order in the step.
            known = 0.5 * (
                self._known(rotors, last_rotation, last_centre)
                + self._known(rotors, rotation, centre)
            )
            gain = 1.0 - np.exp(-2.0 * np.pi * self.bandwidth * dt)
            rest = (momentum - last) / dt - known
            self._estimate = self._estimate + gain * (rest - self._estimate)
        force, moment = self._estimate[:3] @ rotation, self._estimate[3:] @ rotation
        return np.concatenate([force, moment + cross(centre, force)])

    def _momentum(
        self, state: FlightState, q: Array, dq: Array, rotation: Array
    ) -> tuple[Array, Array]:
        """Return the momentum (6,) in the world, and the centre of mass in base axes."""
        in_body = state.velocity @ state.rotation + cross(state.rate, self._mount)
        twist = np.concatenate([in_body @ self._turn, state.rate @ self._turn])
        momentum = self.whole.centroidal_momentum(q, dq, twist)
        centre = self.whole.composite_inertia(q)[1]
        return np.concatenate([rotation @ momentum[:3], rotation @ momentum[3:]]), centre

    def _known(self, rotors: Array, rotation: Array, centre: Array) -> Array:
        """Return what rotors and weight change of the momentum in a second, (6,)."""
        force = rotation @ rotors[:3] + self.whole.mass * _WEIGHT
        moment = rotation @ (rotors[3:] - cross(centre, rotors[:3]))
        return np.concatenate([force, moment])
