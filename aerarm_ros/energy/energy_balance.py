"""Joules by joint and by cause."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Where the energy of n joints went, in some time.

    All but `seconds` are (n,) [J] and add up: what the supply gave is the sum of `parts`.

    Attributes
    ----------
    seconds : float
        [s]
    copper : heat of the windings.
    friction : heat of joints and gears, by the friction model.
    gravity : work against the weight of links and payload, negative where they sank.
    inertia : work into the motion, Coriolis and centrifugal torques included; zero in sum over the
        joints from rest to rest.
    unexplained : work of the drives that the model does not know; zero for a planned motion.
    burnt : braking energy that the power stage burns.
    standby : of the boards, a joint's share.
    recovered : braking energy that the supply took back; part of none of the others.
    """

    seconds: float
    copper: FloatArray
    friction: FloatArray
    gravity: FloatArray
    inertia: FloatArray
    unexplained: FloatArray
    burnt: FloatArray
    standby: FloatArray
    recovered: FloatArray

    PARTS = ('copper', 'friction', 'gravity', 'inertia', 'unexplained', 'burnt', 'standby')

    @classmethod
    def nothing(cls, n: int) -> EnergyBalance:
        """Return the balance of no time."""
        return cls(0.0, *(np.zeros(n) for _ in fields(cls)[1:]))

    def __add__(self, other: EnergyBalance) -> EnergyBalance:
        """Return the balance of both times together."""
        values = (getattr(self, f.name) + getattr(other, f.name) for f in fields(self))
        return EnergyBalance(*values)

    @cached_property
    def parts(self) -> FloatArray:
        """(7, n) what the supply's energy became [J], rows as named by `PARTS`."""
        return np.array([getattr(self, name) for name in self.PARTS])

    @property
    def motors(self) -> FloatArray:
        """(n,) what the supply gave for each motor [J]: all parts but standby."""
        return self.supplied - self.standby

    @property
    def supplied(self) -> FloatArray:
        """(n,) what the supply gave, less what it took back [J]."""
        total: FloatArray = self.parts.sum(axis=0)
        return total

    def as_text(self, joint_names: tuple[str, ...]) -> str:
        """Return a table of joules: a line a joint, and their sum."""
        heads = [*self.PARTS, 'supplied', 'recovered']
        columns = np.vstack([self.parts, self.supplied, self.recovered])
        table = np.column_stack([columns, columns.sum(axis=1)])
        width = max(map(len, (*joint_names, 'all')))
        lines = [' ' * width + ''.join(f'{head:>12}' for head in heads) + '   [J]']
        for name, column in zip((*joint_names, 'all'), table.T, strict=True):
            lines.append(f'{name:{width}}' + ''.join(f'{value:12.3f}' for value in column))
        return '\n'.join(lines)
