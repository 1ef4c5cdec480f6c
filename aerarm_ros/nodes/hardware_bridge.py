"""Connect the motor boards with ROS: exchange one SPI frame with each board every millisecond."""

from __future__ import annotations

from collections.abc import Sequence

from aerarm_ros.ros.bridge.hardware_bridge import PARAMETERS, HardwareBridge
from aerarm_ros.ros.process.node_main import run_node


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge with the boards on the SPI bus."""
    return run_node('hardware_bridge', HardwareBridge, args, PARAMETERS, __doc__)
