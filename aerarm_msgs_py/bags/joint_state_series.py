"""JointState messages of a bag as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class JointStateSeries:
    """M JointState messages of n joints, in the order they were recorded.

    Attributes
    ----------
    names
        n joint names, the order of the columns.
    stamp
        (M,) `header.stamp` [s]; equal or jumping stamps are left as they are.
    log_time
        (M,) time of reception by the recorder [s].
    position, velocity, effort
        (M, n) [rad], [rad/s], [Nm]; NaN where a message hasn't the joint or leaves the
        field empty.
    sequence
        (M,) publication sequence numbers, 0 where unknown.
    """

    names: tuple[str, ...]
    stamp: NDArray[np.float64]
    log_time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    sequence: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.stamp)

    def columns(self, names: Sequence[str]) -> 'JointStateSeries':
        """Return the series with joints chosen and ordered by name.

        Raises
        ------
        KeyError
            If a joint isn't in the series.
        """
        index = {name: k for k, name in enumerate(self.names)}
        missing = [name for name in names if name not in index]
        if missing:
            raise KeyError(f'joints {missing} are not among {list(self.names)}')
        order = [index[name] for name in names]
        return JointStateSeries(
            tuple(names),
            self.stamp,
            self.log_time,
            self.position[:, order],
            self.velocity[:, order],
            self.effort[:, order],
            self.sequence,
        )
