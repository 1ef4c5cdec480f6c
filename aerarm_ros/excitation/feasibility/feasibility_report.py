"""What a motion makes of each limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.excitation.settings.excitation_error import InfeasibleError
from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True)
class LimitMargin:
    """How far a motion stays from one limit.

    Parameters
    ----------
    limit : which limit, such as 'velocity' or 'ground clearance'.
    subject : joint or pair of links.
    reached, allowed : the extreme of the motion and the limit, in `unit`.
    margin : distance to the limit in `unit`, negative beyond it.
    relative : margin as a share of what the limit allows, to compare unlike limits.
    unit : unit of all but `relative`.
    time : when the extreme is reached [s].
    """

    limit: str
    subject: str
    reached: float
    allowed: float
    margin: float
    relative: float
    unit: str
    time: float

    def __str__(self) -> str:
        return (
            f'{self.limit} of {self.subject}: {self.reached:.4g} {self.unit} at '
            f't = {self.time:.2f} s, limit {self.allowed:.4g} {self.unit}'
        )


def peak_margins(
    limit: str,
    unit: str,
    names: Sequence[str],
    times: FloatArray,
    values: FloatArray,
    allowed: FloatArray,
) -> list[LimitMargin]:
    """Return each joint's margin of its largest magnitude; a limit that is infinite is none.

    Parameters
    ----------
    limit, unit : as in `LimitMargin`.
    names : of the n joints.
    times : (M,) when the values are reached [s].
    values : (M, n).
    allowed : (n,) positive.
    """
    margins = []
    for j, name in enumerate(names):
        if np.isfinite(allowed[j]):
            sample = int(np.abs(values[:, j]).argmax())
            reached, bound = float(abs(values[sample, j])), float(allowed[j])
            rest = bound - reached
            margins.append(
                LimitMargin(
                    limit, name, reached, bound, rest, rest / bound, unit, float(times[sample])
                )
            )
    return margins


@dataclass(frozen=True)
class FeasibilityReport:
    """Margins of a motion to every limit that was checked.

    Parameters
    ----------
    margins : one for each limit and subject.
    notes : what was not checked, or held to less than was asked for, in words.
    """

    margins: Sequence[LimitMargin]
    notes: Sequence[str] = ()

    _ROUNDING = 1e-9

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept."""
        return all(margin.margin >= -self._ROUNDING for margin in self.margins)

    @property
    def binding(self) -> LimitMargin:
        """The limit with the smallest relative margin."""
        return min(self.margins, key=lambda margin: margin.relative)

    def worst_of_each(self) -> list[LimitMargin]:
        """Return for each kind of limit the subject that comes closest to it."""
        worst: dict[str, LimitMargin] = {}
        for margin in self.margins:
            if margin.limit not in worst or margin.relative < worst[margin.limit].relative:
                worst[margin.limit] = margin
        return list(worst.values())

    def require(self, what: str) -> None:
        """Raise unless feasible.

        Raises
        ------
        InfeasibleError
            Naming `what` is infeasible, and the limit that binds.
        """
        if not self.feasible:
            raise InfeasibleError(f'{what} is infeasible: {self.binding}')

    def as_table(self) -> str:
        """Return one line for each kind of limit, the closest subject each, then the notes."""
        rows = [
            f'  {m.limit:<17} {m.subject:<24} {m.reached:9.4g} of {m.allowed:9.4g} {m.unit:<8}'
            f' margin {m.margin:9.4g}'
            for m in self.worst_of_each()
        ]
        rows += [f'  note: {note}' for note in self.notes]
        return '\n'.join(rows)
