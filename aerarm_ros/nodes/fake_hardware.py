"""The bridge on emulated boards: everything real down to the bytes, but the bus and the arm."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.answer import Answer
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulated_transport import EmulatedTransport
from aerarm_ros.hardware.emulation import make_emulated_transport
from aerarm_ros.hardware.fault_injection import FAULTS
from aerarm_ros.hardware.fault_request import FORM, FaultRequest
from aerarm_ros.hardware.frame_profile import FrameProfile
from aerarm_ros.nodes.cycle_requests import Action
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
    Parameter(
        'fault',
        '',
        f'fault to inject, at once when it is set: {FORM}, NAME one of {", ".join(FAULTS)}',
        live=True,
    ),
)


class FakeHardware(HardwareBridge):
    """Hardware bridge whose boards are emulated on a physics engine.

    A real arm is carried by hand until its motors hold it. So is this one: enabling takes it
    up where it is, or back to where it started if it fell beyond its limits.
    """

    def __init__(self) -> None:
        self._boards: EmulatedTransport | None = None
        super().__init__('fake_hardware', FAKE_PARAMETERS)

    def make_transport(
        self, config: ArmConfig, robot: Robot, profile: FrameProfile
    ) -> EmulatedTransport:
        """Return emulated boards; writes the true parameters if asked to."""
        values = self.values
        self._boards = transport = make_emulated_transport(
            config,
            robot,
            None if values.seed < 0 else values.seed,
            position=values.initial_position or None,
            profile=profile,
        )
        if values.truth_file:
            text = yaml.safe_dump(transport.plant.true_parameters(), sort_keys=False)
            Path(values.truth_file).write_text(text)
        if values.fault:
            FaultRequest.parse(values.fault, len(transport.boards)).apply(transport)
        return transport

    def actions(self) -> dict[str, Action]:
        """Return the services' actions: those of a bridge, and what can be done to the arm."""
        return {
            **super().actions(),
            'enable': self._enable,
            'inject_fault': self._inject_fault,
            'put_back': self._put_back,
        }

    def use_slack(self, now: float) -> None:
        """Run boards and arm on to the next cycle, while the controllers compute."""
        if self._boards is not None:
            self._boards.advance(now + self.values.period)

    def check_parameters(self, changes: Mapping[str, Any]) -> str:
        """Return why live parameters can't be set, or ''."""
        if self._boards is not None and changes.get('fault'):
            try:
                FaultRequest.parse(changes['fault'], len(self._boards.boards))
            except ValueError as error:
                return f'parameter fault: {error}'
        return super().check_parameters(changes)

    def on_parameter(self, name: str, value: Any) -> None:
        """Take over a live parameter."""
        super().on_parameter(name, value)
        if name == 'fault' and value:
            self.requests.post(self._inject_fault)

    def _enable(self, cycle: BridgeCycle) -> Answer:
        boards = self._boards
        if boards is None or cycle.mode != 'idle':
            return cycle.enable()
        if cycle.gate.is_inside(cycle.q):
            boards.carry()
            return cycle.enable()
        boards.put_back()
        cycle.update(time.monotonic())  # see where it is now
        accepted, message = cycle.enable()
        return Answer(accepted, f'the fallen arm was put back to where it started; {message}')

    def _inject_fault(self, cycle: BridgeCycle) -> Answer:
        fault, boards = self.values.fault, self._boards
        if boards is None or not fault:
            return Answer(False, f'set the parameter fault first: {FORM}')
        FaultRequest.parse(fault, len(boards.boards)).apply(boards)
        return Answer(True, f'{fault}: {FAULTS[fault.partition(":")[0].strip()][0]}')

    def _put_back(self, cycle: BridgeCycle) -> Answer:
        boards = self._boards
        if boards is None or any(board.system_enabled for board in boards.boards):
            return Answer(False, 'the motors are driven: disable first')
        boards.put_back()
        return Answer(True, 'the arm is back where it started, carried until its motors hold it')


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge on the emulated boards."""
    return run_node('fake_hardware', FakeHardware, args)


if __name__ == '__main__':
    sys.exit(main())
