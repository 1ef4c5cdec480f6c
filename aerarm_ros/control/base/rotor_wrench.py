"""Force and moment of a drone's rotors, predicted from the rotor commands."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.motion.signals import Array


def wrench_per_thrust(drone: DroneConfig) -> Array:
    """Return the wrench (6,) on the arm's base per newton of thrust, for m rotors as (6, m)."""
    rotation = drone.mount.rotation.T
    force, moment = drone.allocation[:3], drone.allocation[3:]
    about_base = moment - np.cross(drone.mount.position, force, axisb=0, axisc=0)
    return np.vstack([rotation @ force, rotation @ about_base])


def carrier_parameters(drone: DroneConfig) -> Array:
    """Return the drone's inertial parameters (10,), thesis (3.3), in the arm's base frame."""
    rotation = drone.mount.rotation.T
    centre = rotation @ (np.array(drone.centre_of_mass) - drone.mount.position)
    return parameters_of_body(drone.mass, centre, rotation @ drone.inertia_matrix @ rotation.T)


_PIECES = 64  # number of stored commands: 0.25 s at 250 Hz
# A command beyond the limits saturates the rotor; beyond this multiple its unit is not N.
_ABSURD = 3.0
_FROZEN = 0.5  # [s]; a controller in flight never repeats its numbers for so long


class RotorWrench:
    """Predicts the rotors' thrusts from commands, with saturation and first-order lag.

    A command acts from its arrival plus the latency until the next command acts. The thrust follows
    the command exactly by `T(t) = u + (T_0 - u) exp(-(t - t_0) / T_r)`.

    Parameters
    ----------
    hold_time : float
        Age [s] up to which the last command is used.
    latency : float
        Time from a command's arrival at this node to its rotor [s].

    Attributes
    ----------
    matrix : (6, n) ndarray
        Wrench per thrust at the origin of the arm's base frame, in its axes.
    commanded_force : float
        Sum of the last commanded thrusts [N].
    """

    def __init__(self, drone: DroneConfig, hold_time: float = 0.1, latency: float = 0.0) -> None:
        self._drone = drone
        self._names = drone.rotor_names
        self.matrix = wrench_per_thrust(drone)
        self._low, self._high = drone.column('thrust_min'), drone.column('thrust_max')
        self._rate = 1.0 / drone.column('time_constant')
        self._hold_time = positive('hold_time', hold_time)
        self._latency = non_negative_number('latency', latency)
        self._order: list[int] = list(range(drone.n))
        self._sent_names: tuple[str, ...] = self._names
        # Start [s], initial thrust, and command of each piece.
        self._pieces: deque[tuple[float, Array, Array]] = deque(maxlen=_PIECES)
        self.commanded_force = 0.0
        self._stamp = self._received = self._changed = -np.inf

    def problem(self, now: float) -> str:
        """Return a text if the rotor commands are unusable at `now` [s], or an empty string."""
        age = now - self._received
        if np.isinf(age):
            return 'no rotor commands yet'
        if abs(age) > self._hold_time:
            return f'no good rotor command for {age:.2f} s'
        if now - self._changed > _FROZEN:
            return f'rotor commands unchanged for {now - self._changed:.1f} s'
        return ''

    def offer(self, names: Sequence[str], thrust: Array, stamp: float, now: float) -> None:
        """Process a command of rotor thrusts [N] that was sent at `stamp` [s], received at `now`.

        Raises
        ------
        RejectedInputError
            If the names are not this drone's rotors, the stamp is older than the last, or a value
            is not a thrust.
        """
        if tuple(names) != self._sent_names:
            self._order = self._find(names)
            self._sent_names = tuple(names)
        if len(thrust) != len(self._names):
            raise RejectedInputError(
                f'rotor_command: {len(thrust)} efforts for {len(self._names)} rotors; send the '
                'thrust of each rotor [N] as effort'
            )
        if not np.isfinite(thrust.sum()):
            raise RejectedInputError(
                'rotor_command: a thrust is NaN or infinite; check the publisher'
            )
        thrust = thrust[self._order]
        if np.any(np.abs(thrust) > _ABSURD * np.maximum(np.abs(self._low), self._high)):
            raise RejectedInputError(
                f'rotor_command: {np.abs(thrust).max():.3g} N is far above thrust_max of '
                f'{self._drone.name}; check the unit [N] and the drone file'
            )
        # A stamp far in the past means that the clock was set back, so start again.
        if -1.0 < stamp - self._stamp < 0.0:
            raise RejectedInputError(
                'rotor_command: a message is older than the previous one; run only one publisher'
            )
        command = np.minimum(np.maximum(thrust, self._low), self._high)
        if stamp == self._stamp and self._pieces and np.all(command == self._pieces[-1][2]):
            return  # no new data: a sender that repeats its message counts as silent
        self._stamp = stamp
        self._add(command, now)

    def thrust(self, time: float) -> Array:
        """Return the predicted thrusts (n,) [N] at `time` [s]; zeros before the first command."""
        piece = None
        for piece in reversed(self._pieces):
            if piece[0] <= time:
                break
        if piece is None:
            return np.zeros(len(self._names))
        begin, first, command = piece
        return command + (first - command) * np.exp((min(begin, time) - time) * self._rate)

    def wrench(self, time: float) -> Array:
        """Return the wrench (6,) of the rotors at the base's origin at `time` [s]."""
        return np.asarray(self.matrix @ self.thrust(time))

    def _add(self, command: Array, now: float) -> None:
        self.commanded_force = float(np.linalg.norm(self.matrix[:3] @ command))
        gap = now - self._received
        self._received = now
        begin = now + self._latency
        if not self._pieces or gap <= -self._hold_time:  # first, or clock set back
            self._pieces.clear()
            self._pieces.append((begin, command, command))
            self._changed = now
            return
        if gap >= self._hold_time or np.any(command != self._pieces[-1][2]):
            self._changed = now
        # After a gap too, the thrust continues without a step, although it is unknown. A control
        # law that still uses the rotors would turn a step of the thrust into a step of the torque.
        self._pieces.append((begin, self.thrust(begin), command))

    def _find(self, names: Sequence[str]) -> list[int]:
        """Return, for each of the drone's rotors, its index in the names of a command."""
        if sorted(names) != sorted(self._names):
            raise RejectedInputError(
                f'rotor_command: rotors {list(names)} are not the rotors {list(self._names)} of '
                f'{self._drone.name}; check that drone_file describes this drone'
            )
        return [list(names).index(name) for name in self._names]
