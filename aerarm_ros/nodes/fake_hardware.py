"""The bridge on emulated boards: everything real down to the bytes, but the bus and the arm."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.emulation import make_emulated_transport
from aerarm_ros.hardware.transport import Transport
from aerarm_ros.nodes.hardware_bridge import HardwareBridge
from aerarm_ros.nodes.node_main import run_node
from aerarm_ros.nodes.parameter import Parameter

FAKE_PARAMETERS = (
    Parameter(
        'seed',
        0,
        "seed of the arm's deviations from the drawing and of noise; -1 for an arm as drawn",
        minimum=-1,
    ),
    Parameter(
        'initial_position',
        [],
        "joint angles at the start, in the joints' order; the rest position if empty",
        'rad',
        element=float,
    ),
    Parameter('truth_file', '', "YAML file to write the arm's true parameters to"),
)


class FakeHardware(HardwareBridge):
    """Hardware bridge whose boards are emulated on a physics engine."""

    def __init__(self) -> None:
        super().__init__('fake_hardware', FAKE_PARAMETERS)

    def make_transport(self, config: ArmConfig, robot: Robot) -> Transport:
        """Return emulated boards; writes the true parameters if asked to."""
        values = self.values
        transport = make_emulated_transport(
            config,
            robot,
            None if values.seed < 0 else values.seed,
            position=values.initial_position or None,
        )
        if values.truth_file:
            text = yaml.safe_dump(transport.plant.true_parameters(), sort_keys=False)
            Path(values.truth_file).write_text(text)
        return transport


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge on the emulated boards."""
    return run_node('fake_hardware', FakeHardware, args)


if __name__ == '__main__':
    sys.exit(main())
