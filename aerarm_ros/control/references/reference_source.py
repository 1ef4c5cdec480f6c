"""What every maker of references offers to a control loop."""

from typing import Protocol, TypeVar

from aerarm_ros.motion.float_array import FloatArray

Produced = TypeVar('Produced', covariant=True)


class ReferenceSource(Protocol[Produced]):
    """Says what to follow at each instant."""

    def take_over(self, q: FloatArray) -> None:
        """Start at the present posture (n,) [rad]."""

    def update(self, q: FloatArray, now: float, dt: float) -> Produced:
        """Return the reference at `now` [s], `dt` [s] after the last."""
        ...
