"""The bridge on emulated boards: everything real down to the bytes, but the bus and the arm."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from aerarm_ros.ros.emulation.fake_hardware import PARAMETERS, FakeHardware
from aerarm_ros.ros.process.node_main import run_node


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge on the emulated boards."""
    return run_node('fake_hardware', FakeHardware, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
