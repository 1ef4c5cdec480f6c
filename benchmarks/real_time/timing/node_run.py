"""Measurement of a bridge and a controller node in real time for some seconds."""

import os
import sys
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from timing.arrivals import Arrivals
from timing.diagnosed import Diagnosed

from aerarm_ros.hardware.bridge_modes import OFF
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

sys.path.insert(0, str(Path(__file__).parents[3] / 'test' / 'hardware'))
sys.path.append(str(Path(__file__).parents[2]))
import spi_boards
from flying.arm_model import record_excitation  # noqa: F401 - for other programs
from flying.node_bench import ros_node

EMULATED, REAL = 'fake_hardware', 'hardware_bridge'
EXCITATION = 'excitation'
# Slow, and longer than any run.
LONG_MOTION = {'amplitude': 0.2, 'harmonics': 2, 'fundamental': 0.2, 'periods': 100}
WARM_UP = 2.0  # [s]
_RUNS = count()


class NodeFigures(NamedTuple):
    """Figures of a run of two nodes; times [us], fractions [%].

    Attributes
    ----------
    torque, torque_99
        Time from a state's publication to the torque, median and p99, since the node's start.
    command, command_99
        Time from a state's stamp to the command's arrival at another process of the host.
    answered
        Cycles with a command that responds to the last state.
    missed
        Cycles that the bridge missed.
    cycle
        Median duration of a bridge cycle.
    bridge, controller
        Processor load per core.
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
    return NodeFigures(*np.median(runs, axis=0).tolist())


def why_not(bridge: str) -> str:
    """Return why a bridge cannot be measured on this host, or ''."""
    return spi_boards.missing() if bridge == REAL else ''


def measure(bridge: str, controller: str, seconds: float, ask: bool) -> NodeFigures:
    """Run both nodes, and with `ask` a client of the bridge's parameters; return the figures.

    Both nodes have real-time priority if permitted, as on an arm. The real bridge accesses its
    emulated boards, which run in a separate process, through a preloaded SPI bus.

    Raises
    ------
    ArmClientError
        If the arm does not start to follow its controller; with the last output of both nodes.
    """
    with TemporaryDirectory() as folder:
        logs = [Path(folder) / name for name in (bridge, controller)]
        try:
            with ExitStack() as stack:
                return _run(stack, bridge, controller, logs, seconds, ask)
        except ArmClientError as error:
            said = '\n'.join(log.read_text() for log in logs if log.exists())
            raise ArmClientError(f'{error}\n{said}') from None


def _run(
    stack: ExitStack, bridge: str, controller: str, logs: list[Path], seconds: float, ask: bool
) -> NodeFigures:
    node = stack.enter_context(ros_node(os.getpid() + next(_RUNS)))
    environment, own = {}, {'pace': 'real_time', 'encoders': 'absolute'}
    if bridge == REAL:
        environment = stack.enter_context(spi_boards.SpiBoards()).environment
        own = {'board_timeout': 0.2, 'state_file': ''}
    arm = ArmClient(node, [bridge])
    common = {'lock_memory': True, 'keep_cpus_awake': True}
    leading = {'realtime_priority': 80, **common, **own}
    master = stack.enter_context(NodeProcess(bridge, (), leading, environment, logs[0]))
    arm.wait_for_mode(OFF, 30.0)
    arm.call('enable' if arm.mode == 'idle' else 'home')
    arm.wait_for_mode(['ready', 'running'], 30.0)
    motion = LONG_MOTION if controller == EXCITATION else {}
    answering = {'realtime_priority': 70, **common, **motion}
    slave = stack.enter_context(NodeProcess(controller, (), answering, None, logs[1]))
    diagnosed = Diagnosed(node, bridge)
    stack.callback(diagnosed.destroy)
    arm.wait_for_mode(['running'], 60.0)
    diagnosed.wait_for('timing', 'cycles')
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
    """Return the processor time that a process has used [s]."""
    with open(f'/proc/{process.pid}/stat') as file:
        fields = file.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
