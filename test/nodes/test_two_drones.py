"""Two drones and one ground computer, as three ROS domains of this host."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from forked_executable import run
from own_domain import own_domain
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess

SIDES = ('left', 'right')


class Ground:
    """A node on the ground that stores the modes and diagnostics of both drones."""

    def __init__(self) -> None:
        self.environment = own_domain()
        self.modes: dict[str, list[str]] = {side: [] for side in SIDES}
        self.diagnosed: set[str] = set()
        self._context = Context()
        domain = int(self.environment['ROS_DOMAIN_ID'])
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self._node = rclpy.create_node('client', context=self._context)
        topic = topics.ARM_MODE
        for side, modes in self.modes.items():
            self._node.create_subscription(
                topic.type,
                f'/{side}/{topic.name}',
                lambda m, modes=modes: modes.append(m.data),
                topic.qos,
            )
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnose, 10)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def wait(self, until: Callable[[], object], timeout: float = 60.0) -> bool:
        """Spin until a condition holds; return whether it does."""
        end = time.monotonic() + timeout
        while not until() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)
        return bool(until())

    def newest(self) -> tuple[str, ...]:
        """Return the present mode of each drone's arm."""
        return tuple(modes[-1] if modes else '' for modes in self.modes.values())

    def arm(self, *words: str) -> str:
        """Run `arm` on the ground and return its output."""
        with pytest.MonkeyPatch.context() as patch:
            for name, value in self.environment.items():
                patch.setenv(name, value)
            done = run('arm', *words)
        assert done.returncode == 0, done.stderr + done.stdout
        return done.stdout

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _diagnose(self, message: DiagnosticArray) -> None:
        self.diagnosed.update(s.name.split(':')[0].strip('/') for s in message.status)


def free_port() -> int:
    with closing(socket(AF_INET, SOCK_DGRAM)) as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Ground]:
    """Return the ground with a `ground_link` to each drone, in the drone's namespace."""
    with ExitStack() as stack:
        ground = stack.enter_context(closing(Ground()))
        for side in SIDES:
            drone, link = own_domain(), {'port': free_port(), 'key_file': tmp_path / side}
            arguments = ('--ros-args', '-r', f'__ns:=/{side}', '--')

            def start(name: str, where: dict[str, str], place: str, **given: object) -> None:
                log = tmp_path / f'{place}_{name}.log'
                stack.enter_context(NodeProcess(name, arguments, given, where, log))  # noqa: B023

            start('fake_hardware', drone, side, encoders='absolute')
            start('ground_link', drone, side, address='127.0.0.1', **link)
            while not (tmp_path / side).exists():
                time.sleep(0.05)
            start('ground_link', ground.environment, f'ground_{side}', role='ground',
                  drone='127.0.0.1', **link)  # fmt: skip
        yield ground


def test_each_drone_has_its_own_link_and_e_stop(ground: Ground) -> None:
    assert ground.wait(lambda: ground.newest() == ('idle', 'idle')), ground.modes
    ground.arm('e_stop', '--ros-args', '-r', '__ns:=/left')
    assert ground.wait(lambda: ground.newest()[0] == 'fault'), ground.modes
    ground.wait(lambda: False, 0.5)
    assert ground.newest() == ('fault', 'idle')
    ground.arm('clear_fault', '--ros-args', '-r', '__ns:=/left')
    assert ground.wait(lambda: ground.newest() == ('idle', 'idle')), ground.modes
    ground.arm('e_stop', '--all')
    assert ground.wait(lambda: ground.newest() == ('fault', 'fault')), ground.modes
    links = {f'{side}/ground_link' for side in SIDES}
    assert ground.wait(lambda: links <= ground.diagnosed), ground.diagnosed
