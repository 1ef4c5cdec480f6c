"""What a flight controller commands the rotors, checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.codecs.joint_state_conversion import decode_joint_state
from aerarm_msgs_py.live_topics.raw_reader import RawReader

Array = NDArray[np.float64]


class RotorCommands:
    """Reads rotor_command by the rotors' names.

    Parameters
    ----------
    node
        Owner of the subscription.
    names
        Of the drone's rotors, n of them, in the order of all arrays.
    reject
        Called with the reason why a message is not used.
    """

    def __init__(self, node: Node, names: Sequence[str], reject: Callable[[str], None]) -> None:
        self._names = tuple(names)
        self._cdr = JointStateCdr(self._names)
        self._reject = reject
        self.reader = RawReader(node, topics.ROTOR_COMMAND)

    def newest(self) -> tuple[int, Array] | None:
        """Return stamp [ns] and thrusts (n,) [N] of a new command, None if there is none."""
        message = self.reader.take_newest()
        if message is None:
            return None
        try:
            return self._decode(message[0])
        except ValueError as error:
            self._reject(f'rotor_command: {error}')
            return None

    def destroy(self) -> None:
        """Destroy the subscription."""
        self.reader.destroy()

    def _decode(self, payload: bytes) -> tuple[int, Array]:
        sample = self._cdr.unpack(payload)
        names: Sequence[str] = self._names
        if sample is None:
            names, sample = decode_joint_state(payload)
        if sorted(names) != sorted(self._names):
            raise ValueError(
                f'it is for rotors {", ".join(names) or "without names"}, this drone has '
                f'{", ".join(self._names)}: is the same drone_file given to the flight controller?'
            )
        if sample.effort is None:
            raise ValueError('it has no effort: give the thrust of each rotor [N] as effort')
        thrust = sample.effort[[list(names).index(name) for name in self._names]]
        if not np.all(np.isfinite(thrust)):
            raise ValueError('a thrust is NaN or infinite: check the flight controller')
        return sample.stamp_ns, thrust
