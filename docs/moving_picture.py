"""Films the page of `view` while the emulated arm swings under a flying drone.

    python docs/moving_picture.py [--out docs/images/flight.webp]

First it records the flight, then it plays the recording to the page, 10 s at the full rate of
1 kHz, and waits for the browser at each picture: on a slow computer the film takes longer and
shows the same. Needs Chromium.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rclpy
from PIL import Image
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.nodes.view import View
from aerarm_ros.ros.executors import BackgroundExecutor, spin_until
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient
from aerarm_ros.ros.requests.motion_request import trajectory_message

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / 'benchmarks'), str(ROOT / 'test' / 'nodes')]

from flying.arm_swing import ArmSwing  # noqa: E402
from headless_browser import HeadlessBrowser, until  # noqa: E402

PORT = 8097
DRONE = str(resource('config', 'drone.yaml'))
SHOWN = (
    topics.JOINT_STATES,
    topics.JOINT_COMMAND,
    topics.MOTOR_STATES,
    topics.MOTOR_POWER,
    topics.ODOMETRY,
    topics.ARM_MODE,
    topics.DIAGNOSTICS,
)
SECONDS, BEFORE = 10.0, 10.0  # [s] of the film, and of motion before it, which the plots show
LEAD = 3.0  # [s] from the command to the motion
PAGE_RATE = 30.0  # [Hz] at which the page takes what is new
EVERY = 3  # of these is a picture
SIZE = 1360, 680  # of the page, pixels
WIDTH = 960  # of the film, pixels
QUALITY = 60
PATIENCE = 180.0  # [s] with a node on a busy computer


def record(folder: Path) -> tuple[Path, float]:
    """Fly, and return the bag with the time of the arm at which the film begins [s]."""
    bag = folder / 'flight'
    rclpy.init()
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown)
        for name, parameters in {
            # Without noise the IMU of a drone that is held counts as frozen.
            'fake_hardware': {'encoders': 'absolute', 'imu_noise': [0.05, 0.002]},
            'computed_torque': {'base_motion': 'free', 'rotor_share': 0.0, 'path_tolerance': 10.0},
            'base_reaction': {'lead': 0.05},
            'flight_control': {},
        }.items():
            given = {'drone_file': DRONE, **parameters}
            node = NodeProcess(name, (), given, log=folder / f'{name}.log')
            stack.callback(node.stop)
        wanted = [topic.name for topic in SHOWN]
        given = {'bag': str(bag), 'topics': wanted}
        recorder = NodeProcess('recorder', (), given, log=folder / 'recorder.log')
        stack.callback(recorder.stop)
        asker = rclpy.create_node('moving_picture')
        stack.callback(asker.destroy_node)
        return bag, swing(asker)


def swing(node: Node) -> float:
    """Move the arm as long as the film needs; return when that begins, in the arm's time [s]."""
    client = ArmClient(node, ['fake_hardware'], ['enable'])
    client.call('enable', PATIENCE)
    client.wait_for_mode(['running'], PATIENCE)
    newest: list[float] = []

    def keep(message: JointState) -> None:
        newest[:] = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec]

    topic = topics.JOINT_STATES
    node.create_subscription(topic.type, topic.name, keep, topic.qos)
    topic = topics.JOINT_TRAJECTORY
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    until(publisher.get_subscription_count)
    spin_until(node, lambda: newest, 10.0)
    begin = newest[0] + LEAD
    motion = ArmSwing('fast', BEFORE + SECONDS + 5.0)
    names = load_arm_config().joint_names
    publisher.publish(trajectory_message(motion, names, round(1e9 * begin)))
    end = begin + BEFORE + SECONDS
    spin_until(node, lambda: newest[0] > end, 2.0 * PATIENCE)
    return begin


def messages(bag: Path) -> list[tuple[float, str, bytes]]:
    """Return time of the arm [s], topic and bytes of all messages, in their order."""
    states = read_joint_states(bag)
    found = []
    for block in Bag(bag).blocks():
        times = np.interp(1e-9 * block.log_time, states.log_time, states.stamp)
        found += [
            (when, block.topic, data) for when, data in zip(times, block.payloads, strict=True)
        ]
    return sorted(found, key=lambda item: item[0])


class Replay:
    """Publishes a recording piece by piece."""

    def __init__(self, node: Node, recorded: Sequence[tuple[float, str, bytes]]) -> None:
        self._publishers = {
            '/' + topic.name.lstrip('/'): node.create_publisher(topic.type, topic.name, topic.qos)
            for topic in SHOWN
        }
        self._rest = iter(recorded)
        self._next = next(self._rest)

    def until(self, end: float) -> None:
        """Publish what was recorded before a time of the arm [s]."""
        while self._next[0] < end:
            _, topic, data = self._next
            self._publishers[topic].publish(data)
            self._next = next(self._rest)


def film(view: View, replay: Replay, begin: float, browser: HeadlessBrowser) -> Iterator[bytes]:
    """Yield pictures as JPEG; the page's clock is that of the recording."""
    start = time.monotonic()
    steps = int((BEFORE + SECONDS) * PAGE_RATE)
    for step in range(steps):
        replay.until(begin + step / PAGE_RATE)
        time.sleep(0.02)  # the middleware delivers
        # Every text and plot at each picture.
        view._update(round(1e9 * (start + step / PAGE_RATE)), step % EVERY)
        if step < BEFORE * PAGE_RATE or step % EVERY:
            continue
        time.sleep(0.1)  # the browser receives and draws
        yield base64.b64decode(
            browser.call('Page.captureScreenshot', format='jpeg', quality=92)['data']
        )


def pictures(folder: Path, recorded: Sequence[tuple[float, str, bytes]], begin: float) -> list:
    """Return the pictures of the film, and check the rate that the page shows."""
    parameters = {'port': PORT, 'drone_file': DRONE, 'rate': PAGE_RATE}
    given = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
    rclpy.init(args=['--ros-args', *given])
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown)
        view = View()
        stack.callback(view.close)
        stack.enter_context(BackgroundExecutor(view._node))
        player = rclpy.create_node('replay')
        stack.callback(player.destroy_node)
        replay = Replay(player, recorded)
        time.sleep(1.0)  # subscriptions find publishers
        browser = HeadlessBrowser(f'http://127.0.0.1:{PORT}', folder / 'profile')
        stack.callback(browser.close)
        width, height = SIZE
        browser.call(
            'Emulation.setDeviceMetricsOverride',
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        until(lambda: 'EMERGENCY STOP' in browser.text())
        until(lambda: 'Software WebGL' in browser.text())
        browser.evaluate('document.querySelector(".mantine-Notification-closeButton").click()')
        found = list(film(view, replay, begin, browser))
        rate = browser.text().partition('joint_states at ')[2].split()[0]
        if abs(float(rate) - 1000.0) > 20.0:
            raise SystemExit(f'the page shows joint_states at {rate} Hz instead of 1 kHz')
        return [Image.open(io.BytesIO(data)).convert('RGB') for data in found]


def main() -> int:
    """Film, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'images' / 'flight.webp')
    out = parser.parse_args().out
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', '91')
    with TemporaryDirectory() as name:
        folder = Path(name)
        bag, begin = record(folder)
        found = pictures(folder, messages(bag), begin)
    height = round(WIDTH * SIZE[1] / SIZE[0])
    small = [picture.resize((WIDTH, height), Image.Resampling.LANCZOS) for picture in found]
    out.parent.mkdir(parents=True, exist_ok=True)
    small[0].save(
        out, save_all=True, append_images=small[1:], duration=round(1e3 * EVERY / PAGE_RATE),
        loop=0, quality=QUALITY, method=6,
    )  # fmt: skip
    print(f'{out}: {len(small)} pictures, {out.stat().st_size / 1e6:.2f} MB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
