"""Use a SpidevTransport and print the result, for test_spidev_bus.py.

Usage: python spi_client.py CONFIG EXCHANGES [SECONDS]

After half of the exchanges the program prints a line and waits for one. With SECONDS it does so
again at the end, and then exchanges frames until every board answers, for at most SECONDS.
"""

import json
import sys
import time

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.frames.board_messages import BoardCommand
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.transports.spidev_transport import (
    SpidevTransport,
    TransportError,
    self_test,
)


def exchange(transport: SpidevTransport, boards: int, count: int) -> dict:
    """Exchange frames with every board; return each board's answers."""
    codec = FrameCodec(load_profile())
    good, indices, slowest = [0] * boards, [0] * boards, [0.0] * boards
    for index in range(1, count + 1):
        for board in range(boards):
            answer = transport.exchange(board, codec.encode(BoardCommand(index=index)))
            state = codec.decode(answer)
            if state is not None:
                good[board] += 1
                indices[board] = state.index
            slowest[board] = max(slowest[board], transport.exchange_time(board))
        time.sleep(1e-3)
    problems = [transport.problem(board) for board in range(boards)]
    return {'good': good, 'index': indices, 'problems': problems, 'slowest': slowest}


def exchange_until_good(transport: SpidevTransport, boards: int, seconds: float) -> dict:
    """Exchange frames until every board answers at once; return the last report."""
    end = time.monotonic() + seconds
    while True:
        report = exchange(transport, boards, 1)
        if report['good'] == [1] * boards or time.monotonic() > end:
            return report


def main(path: str, count: int, seconds: float = 0.0) -> dict:
    config = load_arm_config(path or None)
    transport = SpidevTransport(config)
    try:
        transport.open()
    except TransportError as error:
        return {'error': str(error)}
    report = {
        'self_test': [list(answer) for answer in self_test(transport, config, load_profile())]
    }
    report['before'] = exchange(transport, len(config.boards), count)
    print('half', flush=True)
    sys.stdin.readline()
    report['after'] = exchange(transport, len(config.boards), count)
    if seconds:
        print('end', flush=True)
        sys.stdin.readline()
        report['later'] = exchange_until_good(transport, len(config.boards), seconds)
    transport.close()
    transport.close()
    return report


if __name__ == '__main__':
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]), *map(float, sys.argv[3:]))))
