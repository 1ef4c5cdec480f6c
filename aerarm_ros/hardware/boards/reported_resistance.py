"""What the boards say of their motors' windings."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.hardware.boards.board_link import BoardLink
from aerarm_ros.hardware.gate.command_buffer import Array


def resistance_by_boards(links: Sequence[BoardLink], n: int) -> Array:
    """Return the phase resistance of each of n motors as their boards report it, (n,) [ohm].

    NaN where frames carry none, and where a board reports zero, which stands for unknown.
    """
    resistance = np.full(n, np.nan)
    for link in links:
        for joint, channel in link.joints:
            resistance[joint] = link.state.coil_resistance[channel] or np.nan
    return resistance
