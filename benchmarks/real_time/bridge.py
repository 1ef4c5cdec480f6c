"""Computing time of the bridge's 1 kHz cycle, and its timing accuracy with a running controller.

The first part measures, in this process, the frame codec, the cycle with emulated boards, and
100,000 cycles, whose memory and cost must not grow. The second part runs three processes over real
DDS in real time: fake_hardware, computed_torque, and a client that gets and sets parameters of the
bridge ten times per second. A bare loop and cyclictest run in parallel.
"""

import argparse
import gc
import resource
import sys
import time
import timeit
from contextlib import ExitStack

import numpy as np
from bare_loop import BareLoops
from timing.diagnosed import Diagnosed
from timing.node_run import processor_time, ros_node

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.realtime.periodic_loop import TimingStatistics
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

PERIOD = 1e-3
BRIDGE, CONTROLLER = 'fake_hardware', 'computed_torque'
STATISTICS = ('mean', 'std', 'p50', 'p99', 'p99.9', 'max')
SWING = np.array([0.5, 0.1, 0.5, 0.5])


def codec_costs() -> None:
    codec = FrameCodec(load_profile())
    command = BoardCommand(position=[1.0, 2.0], velocity=[3.0, 4.0], kp=[5.0, 5.0], kd=[0.2, 0.2])
    state = BoardState()
    frame = codec.encode_state(BoardState(position=[1.0, 2.0], velocity=[3.0, 4.0]))
    for name, call in (
        ('encode a command frame', lambda: codec.encode(command)),
        ('decode a sensor frame', lambda: codec.decode(frame, state)),
    ):
        best = min(timeit.repeat(call, number=2000, repeat=5)) / 2000
        print(f'{name:38}{1e6 * best:8.1f} us')


def cycle_costs(cycles: int) -> None:
    """Run a bridge on emulated boards at full speed; compare its beginning and end."""
    config = load_arm_config().with_encoders('absolute')
    boards = make_emulated_transport(config, load_robot(), 1)
    cycle = BridgeCycle(config, boards)
    now = 100.0
    first, last, emulation = TimingStatistics(), TimingStatistics(), TimingStatistics()
    blocks = 0
    for index in range(-2000, cycles):
        now += PERIOD
        if index == -1980:
            cycle.enable()
        if index >= 0:
            velocity = SWING * np.sin(3.0 * now)
            offered = OfferedCommand(config.joint_names, None, velocity, None, PERIOD, 'bench')
            cycle.command(offered, now)
        start = time.perf_counter_ns()
        boards.advance(now)
        half = time.perf_counter_ns()
        cycle.update(now)
        end = time.perf_counter_ns()
        if 0 <= index < 1000:
            first.add(end - start)
        elif index >= cycles - 1000:
            last.add(end - start)
            emulation.add(half - start)
        if index == 1000:
            gc.collect()
            blocks, memory = sys.getallocatedblocks(), peak_memory()
    gc.collect()
    print(f'{"cycle, boards emulated: first 1000":38}{1e6 * first.summary().p50:8.1f} us (median)')
    print(f'{"last 1000":>38}{1e6 * last.summary().p50:8.1f} us')
    print(f'{"of it physics of arm and motors":>38}{1e6 * emulation.summary().p50:8.1f} us')
    print(
        f'{cycles} cycles: {sys.getallocatedblocks() - blocks:+d} memory blocks, '
        f'{peak_memory() - memory:+d} KiB since the 1000th, mode {cycle.mode}'
    )


def peak_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def real_time_run(seconds: float) -> None:
    with ros_node() as node, ExitStack() as stack:
        diagnosed, arm = Diagnosed(node, BRIDGE), ArmClient(node, [BRIDGE])
        bridge, controller = (
            stack.enter_context(NodeProcess(name, (), {'lock_memory': True, **parameters}))
            for name, parameters in (
                (BRIDGE, {'realtime_priority': 80, 'pace': 'real_time', 'encoders': 'absolute'}),
                (CONTROLLER, {'realtime_priority': 70}),
            )
        )
        arm.wait_for_mode(['idle'], 30.0)
        arm.call('enable')
        arm.wait_for_mode(['running'], 30.0)
        diagnosed.wait_for(CONTROLLER)
        diagnosed.spin(2.0)
        processes = {'bridge': bridge, 'controller': controller}
        used = {name: processor_time(process) for name, process in processes.items()}
        before, start = dict(diagnosed.values['timing']), time.monotonic()
        bare = BareLoops(seconds)
        answers = diagnosed.use_parameters(seconds)
        diagnosed.spin(1.1)
        passed = time.monotonic() - start
        used = {name: processor_time(p) - used[name] for name, p in processes.items()}
        report(diagnosed, before, answers)
        print(*bare.lines(), sep='\n')
        for name, share in used.items():
            print(f'{"CPU of the " + name:38}{100.0 * share / passed:8.1f} % of a core')
        print(f'{"mode at the end":38}{diagnosed.values["arm"]["mode"]:>8}')


def report(diagnosed: Diagnosed, before: dict[str, str], answers: int) -> None:
    timing = diagnosed.values['timing']

    def counted(name: str) -> int:
        return int(timing[name]) - int(before[name])

    cycles, missed = counted('cycles'), counted('missed cycles')
    fresh = counted('commands answering the last state')
    share = 100.0 * missed / max(cycles + missed, 1)
    print(f'{"cycles run, missed":38}{cycles:8d} {missed:7d} ({share:.2f} %)')
    print(f'{"fresh commands":38}{100.0 * fresh / max(cycles, 1):8.2f} % (goal 99.9, idle machine)')
    print(f'{"parameter answers":38}{answers:8d}')
    print(f'{"[us]":38}' + ''.join(f'{name:>8}' for name in STATISTICS))
    for what in ('period', 'wake lateness', 'execution time', 'command age'):
        row = ''.join(f'{timing[f"{what} {name} [us]"]:>8}' for name in STATISTICS)
        print(f'{what:38}{row}')
    controller = diagnosed.values[CONTROLLER]
    latency = ', '.join(f'{name} {controller[f"answer {name} [us]"]}' for name in ('p50', 'p99'))
    print(f'{"state to torque [us]":38}{latency}')
    print(f'{"timing status":38}{diagnosed.messages["timing"]}')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0, help='duration of the run [s]')
    parser.add_argument(
        '--pure-cycles', type=int, default=100_000, help='number of cycles without ROS'
    )
    options = parser.parse_args()
    codec_costs()
    cycle_costs(options.pure_cycles)
    try:
        real_time_run(options.seconds)
    except ArmClientError as error:
        raise SystemExit(f'bridge: {error}') from None


if __name__ == '__main__':
    main()
