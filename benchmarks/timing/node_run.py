"""A bridge and one that answers it, as people run them, measured for some seconds in real time."""

import os
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from rclpy.node import Node
from timing.arrivals import Arrivals
from timing.diagnosed import Diagnosed

from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient

sys.path.insert(0, str(Path(__file__).parents[2] / 'test' / 'hardware'))
import spi_boards

EMULATED, REAL = 'fake_hardware', 'hardware_bridge'
EXCITATION = 'excitation'
# Gentle, and longer than any run.
LONG_MOTION = {'amplitude': 0.2, 'harmonics': 2, 'fundamental': 0.2, 'periods': 100}
WARM_UP = 2.0  # [s]


@dataclass(frozen=True)
class NodeFigures:
    """What a run of two nodes showed; times [us], shares [%].

    Attributes
    ----------
    torque, torque_99
        From a state's stamp to the torque, median and 99 % quantile, since the node's start.
    command, command_99
        From a state's stamp to the command's arrival at another process of the host.
    answered
        Cycles with a command that answers the last state.
    missed
        Cycles that the bridge missed.
    cycle
        Time that a cycle of the bridge takes, median.
    bridge, controller
        Processor time of a core.
    """

    torque: float
    torque_99: float
    command: float
    command_99: float
    answered: float
    missed: float
    cycle: float
    bridge: float
    controller: float


def median(runs: list[NodeFigures]) -> NodeFigures:
    """Return the median of each figure."""
    names = [field.name for field in fields(NodeFigures)]
    return NodeFigures(*(float(np.median([getattr(run, name) for run in runs])) for name in names))


def why_not(bridge: str) -> str:
    """Return why a bridge cannot be measured on this host, or ''."""
    return spi_boards.missing() if bridge == REAL else ''


def measure(node: Node, bridge: str, controller: str, seconds: float, ask: bool) -> NodeFigures:
    """Run both, and with `ask` a client of the bridge's parameters, and return the figures.

    Both have real-time priority where it is granted, as on an arm. The real bridge reaches its
    emulated boards, which are a process of their own, through a preloaded SPI bus.
    """
    with ExitStack() as stack:
        environment, own = {}, {'pace': 'real_time'}
        if bridge == REAL:
            environment = stack.enter_context(spi_boards.SpiBoards()).environment
            own = {'board_timeout': 0.2}
        arm = ArmClient(node, [bridge])
        common = {'lock_memory': True, 'keep_cpus_awake': True}
        run = stack.enter_context
        master = run(
            NodeProcess(
                bridge,
                (),
                {'realtime_priority': 80, **common, **own},
                environment,
                Path(os.devnull),
            )
        )
        motion = LONG_MOTION if controller == EXCITATION else {}
        answering = {'realtime_priority': 70, **common, **motion}
        arm.wait_for_mode(['idle'], 30.0)
        arm.call('enable')
        arm.wait_for_mode(['ready', 'running'], 30.0)
        slave = run(NodeProcess(controller, (), answering, None, Path(os.devnull)))
        diagnosed = Diagnosed(node, bridge)
        stack.callback(diagnosed.destroy)
        # Who starts in a killed one's place is deaf at first (docs/decisions.md, 58).
        arm.wait_for_mode(['running'], 60.0)
        diagnosed.wait_for(controller, 'answer p50 [us]')
        diagnosed.spin(WARM_UP)
        return _figures(diagnosed, {'bridge': master, controller: slave}, seconds, ask)


def _figures(
    diagnosed: Diagnosed, processes: dict[str, NodeProcess], seconds: float, ask: bool
) -> NodeFigures:
    (_, controller), (master, slave) = processes, processes.values()
    before, start = dict(diagnosed.values['timing']), time.monotonic()
    used = processor_time(master), processor_time(slave)
    arrivals = Arrivals(seconds)
    if ask:
        diagnosed.use_parameters(seconds)
    else:
        diagnosed.spin(seconds)
    diagnosed.spin(1.1)  # for the last status
    passed = 0.01 * (time.monotonic() - start)
    shares = (processor_time(master) - used[0]) / passed, (processor_time(slave) - used[1]) / passed
    timing, answer = diagnosed.values['timing'], diagnosed.values[controller]

    def counted(name: str) -> int:
        return int(timing[name]) - int(before[name])

    cycles, missed = counted('cycles'), counted('missed cycles')
    return NodeFigures(
        float(answer['answer p50 [us]']),
        float(answer['answer p99 [us]']),
        *arrivals.quantiles(),
        100.0 * counted('commands answering the last state') / max(cycles, 1),
        100.0 * missed / max(cycles + missed, 1),
        float(timing['execution time p50 [us]']),
        *shares,
    )


def processor_time(process: NodeProcess) -> float:
    """Processor time that a process has used [s]."""
    with open(f'/proc/{process.pid}/stat') as file:
        fields = file.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
