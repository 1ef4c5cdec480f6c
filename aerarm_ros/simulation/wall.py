"""Simulated compliant wall, which the tool of a simulated arm can touch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.motion.signals import Array


@dataclass(frozen=True)
class WallParameters:
    """Position, stiffness and friction of a simulated wall.

    Attributes
    ----------
    point : tuple of float
        A point of the undeformed surface in the world [m].
    normal : tuple of float
        Direction into the wall, in the world; any length.
    stiffness, damping : float
        Stiffness [N/m] and damping [Ns/m] along the normal.
    friction : float
        Coefficient of Coulomb friction [-].
    yields_after : float
        Time since the first touch after which the wall moves away [s]; infinite for never.
    yield_speed : float
        Speed of that motion along the normal [m/s]; infinite for a wall that disappears.

    Raises
    ------
    ValueError
        If a value is NaN or negative, or stiffness or normal is zero.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    stiffness: float
    damping: float = 10.0
    friction: float = 0.3
    yields_after: float = np.inf
    yield_speed: float = np.inf

    def __post_init__(self) -> None:
        """Check that every parameter of the wall is in its range."""
        place = np.array([*self.point, *self.normal], dtype=float)
        if place.shape != (6,) or not np.all(np.isfinite(place)) or not np.any(place[3:]):
            raise ValueError('the wall needs a finite point and a finite normal that is not zero')
        numbers = self.stiffness, self.damping, self.friction, self.yields_after, self.yield_speed
        if not all(number >= 0.0 for number in numbers) or not 0.0 < self.stiffness < np.inf:
            raise ValueError(
                'wall: the stiffness must be positive, and the other numbers not negative'
            )


class Wall:
    """Simulated wall that acts on a touching point by spring, damper and dry friction.

    The force along the normal is `k d + c dd/dt` for a depth d, and never pulls. A tangential
    spring of the same stiffness models the friction. It slips at the friction coefficient times
    the normal force.

    Attributes
    ----------
    force : (3,) ndarray
        Last force on the point, in the world [N].
    """

    def __init__(self, parameters: WallParameters) -> None:
        self.parameters = parameters
        self._point = np.array(parameters.point, dtype=float)
        normal = np.array(parameters.normal, dtype=float)
        self._normal = normal / np.linalg.norm(normal)
        self.reset()

    def reset(self) -> None:
        """Reset the wall to the state before the first touch."""
        self.force = np.zeros(3)
        self._depth: float | None = None
        self._anchor: Array | None = None  # tangential point at which the friction's spring rests
        self._touched_for: float | None = None

    def update(self, place: ArrayLike, dt: float) -> Array:
        """Return the force (3,) [N] on a point at `place` (3,) [m]; call every `dt` [s]."""
        wall, offset = self.parameters, np.asarray(place, dtype=float) - self._point
        depth = float(offset @ self._normal)
        if self._touched_for is not None:
            self._touched_for += dt
            depth -= self._yielded(self._touched_for)
        before, self._depth = self._depth, depth
        pressed = 0.0
        if depth > 0.0 and before is not None:
            pressed = max(0.0, wall.stiffness * depth + wall.damping * (depth - before) / dt)
        if pressed == 0.0:
            self._anchor, self.force = None, np.zeros(3)
            return self.force
        if self._touched_for is None:
            self._touched_for = 0.0
        self.force = self._rubbed(offset, pressed) - pressed * self._normal
        return self.force

    def _yielded(self, touched_for: float) -> float:
        """Return how far [m] the wall has yielded since the first touch."""
        wall, late = self.parameters, touched_for - self.parameters.yields_after
        return wall.yield_speed * late if late > 0.0 else 0.0

    def _rubbed(self, offset: Array, pressed: float) -> Array:
        """Return the friction force (3,) [N] on the touching point under a normal force [N]."""
        wall, along = self.parameters, offset - (offset @ self._normal) * self._normal
        if self._anchor is None:
            self._anchor = along
        stretched = along - self._anchor
        most, length = wall.friction * pressed / wall.stiffness, float(np.linalg.norm(stretched))
        if length > most:
            stretched = (most / length) * stretched
            self._anchor = along - stretched
        return np.asarray(-wall.stiffness * stretched)
