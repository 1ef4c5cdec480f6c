"""Run the bridge with emulated motor boards, which drive a simulated arm."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from aerarm_ros.ros.bridge.hardware_bridge import HardwareBridge
from aerarm_ros.ros.emulation.emulated_arm import PARAMETERS, EmulatedArm
from aerarm_ros.ros.process.node_main import run_node

NAME = 'fake_hardware'


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge on the emulated boards."""
    create = partial(HardwareBridge, NAME, EmulatedArm())
    return run_node(NAME, create, args, PARAMETERS, __doc__)
