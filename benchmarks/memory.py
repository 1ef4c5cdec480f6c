"""What five nodes at 1 kHz do to memory over time: the slope of each.

`fake_hardware` (driven and held), `computed_torque`, `base_reaction`, `recorder` and `view`, with
somebody who looks at it, run as processes. What each has to itself is read every two seconds, and
its proportional and resident set size (PSS, RSS: the first also changes with whoever else shares
its libraries). After a warm-up a line is fitted to each. Its uncertainty is twice the standard
error, widened for samples that depend on each other. For an endurance test: `--minutes 30`.
"""

import argparse
import os
import socket
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient

PERIOD = 2.0  # [s] between two looks
WARM_UP = 0.25  # share of the run


def memory(pid: int) -> tuple[float, ...]:
    """Return what a process has to itself, its PSS and its RSS [KiB]."""
    lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()[1:]
    sizes = {line.split(':')[0]: float(line.split()[1]) for line in lines}
    return sizes['Private_Clean'] + sizes['Private_Dirty'], sizes['Pss'], sizes['Rss']


def slope(minutes: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """Return the slope of (k,) sizes and twice its standard error [a minute].

    Samples that follow each other are alike: fewer of them count, by the correlation of
    neighbouring residuals.
    """
    time = minutes - minutes.mean()
    rate = time @ size / (time @ time)
    rest = size - size.mean() - rate * time
    spread = rest @ rest
    if spread < 1e-9:
        return rate, 0.0
    alike = min(max(rest[1:] @ rest[:-1] / spread, 0.0), 0.99)
    error = np.sqrt(spread / (len(size) - 2) / (time @ time))
    return rate, 2.0 * error * np.sqrt((1.0 + alike) / (1.0 - alike))


def look(port: int) -> None:
    """Look at the page until it ends: a client that takes what it is sent."""
    import msgspec  # comes with viser

    camera = {
        'type': 'ViewerCameraMessage',
        'wxyz': [1.0, 0.0, 0.0, 0.0],
        'position': [0.8, -0.9, 0.7],
        'fov': 1.3,
        'near': 0.01,
        'far': 1000.0,
        'image_height': 900,
        'image_width': 1400,
        'look_at': [0.0, 0.0, 0.3],
        'up_direction': [0.0, 0.0, 1.0],
    }
    host = f'127.0.0.1:{port}'
    protocol = f'viser-v{viser.__version__}'
    with connect(
        f'ws://{host}', origin=f'http://{host}', subprotocols=[protocol], max_size=None
    ) as page:
        page.send(msgspec.msgpack.encode(camera))
        try:
            while True:
                page.recv()
        except ConnectionClosed:
            return


def start(folder: Path, stack: ExitStack) -> dict[str, NodeProcess]:
    """Start the nodes, drive the arm, and look at the page."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    nodes: dict[str, NodeProcess] = {}

    def run(name: str, **parameters: object) -> None:
        log = folder / f'{name}.log'
        nodes[name] = stack.enter_context(NodeProcess(name, (), parameters, log=log))

    rclpy.init(args=[])
    node = rclpy.create_node('bench')
    arm = ArmClient(node, ['fake_hardware'])
    run('recorder', bag=folder / 'bag')
    run('fake_hardware', realtime_priority=80)
    arm.wait_for_mode(['idle'], 60.0)
    arm.call('enable')
    arm.wait_for_mode(['ready'], 60.0)
    run('computed_torque', realtime_priority=79)
    run('base_reaction')
    run('view', port=port)
    arm.wait_for_mode(['running'], 60.0)
    node.destroy_node()
    rclpy.shutdown()
    deadline = time.monotonic() + 60.0
    while 'shown at' not in nodes['view'].tail():
        if time.monotonic() > deadline:
            raise SystemExit(f'memory: the page is not served:\n{nodes["view"].tail()}')
        time.sleep(0.1)
    threading.Thread(target=look, args=[port], daemon=True).start()
    return nodes


def watch(nodes: dict[str, NodeProcess], minutes: float) -> dict[str, np.ndarray]:
    """Return (k, 4) time [min] and memory [KiB] of each node."""
    samples: dict[str, list[tuple[float, ...]]] = {name: [] for name in nodes}
    begun = time.monotonic()
    while (passed := (time.monotonic() - begun) / 60.0) < minutes:
        for name, node in nodes.items():
            if node.returncode is not None:
                raise SystemExit(f'memory: {name} has ended:\n{node.tail()}')
            samples[name].append((passed, *memory(node.pid)))
        time.sleep(PERIOD)
    return {name: np.array(rows) for name, rows in samples.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=3.0, help='how long is looked')
    options, _ = parser.parse_known_args()
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        nodes = start(Path(folder), stack)
        samples = watch(nodes, options.minutes)
        for node in reversed(nodes.values()):
            node.stop()
        print(nodes['fake_hardware'].tail(1))
        print(nodes['recorder'].tail(1))
    print(f'{"":16} {"own":>8}  slope, KiB a minute: {"own":>4} {"PSS":>18} {"RSS":>18}')
    for name, rows in samples.items():
        minutes, *sizes = rows[rows[:, 0] >= WARM_UP * options.minutes].T
        slopes = [
            f'{rate:+9.1f} ± {error:6.1f}' for rate, error in (slope(minutes, x) for x in sizes)
        ]
        print(f'{name:16} {sizes[0][-1] / 1024:4.1f} MiB {"":7} {" ".join(slopes)}')


if __name__ == '__main__':
    main()
