"""Computing time of the bridge's 1 kHz cycle, without ROS.

The benchmark measures the frame codec, the cycle with emulated boards, and 100,000 cycles, whose
memory and cost must not grow. `latency.py` measures running nodes in real time.
"""

import argparse
import gc
import resource
import sys
import time
import timeit

import numpy as np

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.realtime.periodic_loop import TimingStatistics

PERIOD = 1e-3
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--pure-cycles', type=int, default=100_000, help='number of cycles without ROS'
    )
    options = parser.parse_args()
    codec_costs()
    cycle_costs(options.pure_cycles)


if __name__ == '__main__':
    main()
