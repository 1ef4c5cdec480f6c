import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import (
    PROFILES_FILE,
    NodeProcess,
    has_packaged_profile,
    ros_environment,
    use_packaged_profile,
)

# A node that says which of Fast DDS's shared memory segments its process has mapped [bytes].
NODE = """
import re
from pathlib import Path
import rclpy
from aerarm_ros.ros.process.node_main import run_node

class Node:
    status = 0

    def __init__(self):
        self._node = rclpy.create_node('seen')

    def run(self):
        line = re.compile(r'^(\\w+)-(\\w+) .*/dev/shm/fastrtps_\\w+$', re.MULTILINE)
        ranges = line.findall(Path('/proc/self/maps').read_text())
        print(*(int(end, 16) - int(start, 16) for start, end in ranges))

    def close(self):
        self._node.destroy_node()

raise SystemExit(run_node('seen', Node, []))
"""
# A node that knows nothing of this package: it hears a topic and calls a service of the bridge.
PLAIN_NODE = """
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node('plain')
modes = []
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(String, 'arm_mode', lambda message: modes.append(message.data), latched)
client = node.create_client(Trigger, 'fake_hardware/e_stop')
while not modes:
    rclpy.spin_once(node)
client.wait_for_service()
answer = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, answer)
print(modes, answer.result() is not None)  # on a busy machine it may be too late for the cycle
"""
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
MIB = 1024**2
USERS_PROFILE = """
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors><transport_descriptor>
    <transport_id>mine</transport_id><type>SHM</type><segment_size>3145728</segment_size>
  </transport_descriptor></transport_descriptors>
  <participant profile_name="mine" is_default_profile="true"><rtps>
    <userTransports><transport_id>mine</transport_id></userTransports>
  </rtps></participant>
</profiles>
"""


def segments(environment: dict[str, str]) -> list[int]:
    """Return the sizes in whole MiB; Fast DDS's own default is half of one."""
    command = [sys.executable, '-c', NODE]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [int(size) // MIB for size in run.stdout.split()]


def test_a_link_to_the_packaged_profile_is_the_packaged_profile(tmp_path: Path) -> None:
    link = tmp_path / 'profile.xml'
    assert not has_packaged_profile({PROFILES_FILE: str(link)})
    link.symlink_to(resource('config', 'fastdds.xml'))
    assert has_packaged_profile({PROFILES_FILE: str(link)})


def test_a_node_started_by_hand_runs_with_the_packaged_profile(ros_domain) -> None:
    environment = ros_environment(ros_domain) | {PROFILES_FILE: ''}
    assert 4 in segments(environment)


def test_the_profile_that_the_user_chose_stays(ros_domain, tmp_path: Path) -> None:
    mine = tmp_path / 'mine.xml'
    mine.write_text(USERS_PROFILE)
    environment = ros_environment(ros_domain) | {PROFILES_FILE: str(mine)}
    assert 3 in segments(environment)
    use_packaged_profile(environment)
    assert environment[PROFILES_FILE] == str(mine)


def test_a_child_process_gets_the_packaged_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PROFILES_FILE, raising=False)
    for name, value, profile in (
        (RANGE, 'LOCALHOST', 'fastdds_loopback.xml'),
        (RANGE, 'SUBNET', 'fastdds.xml'),
        ('ROS_STATIC_PEERS', '192.168.1.2', 'fastdds.xml'),
    ):
        chosen = ros_environment({RANGE: 'LOCALHOST', name: value})
        assert Path(chosen[PROFILES_FILE]) == resource('config', profile)
        # A child may be told of another range than its parent.
        chosen |= {RANGE: 'SUBNET'}
        use_packaged_profile(chosen)
        assert Path(chosen[PROFILES_FILE]) == resource('config', 'fastdds.xml')


def test_the_profiles_differ_in_the_interfaces_only() -> None:
    everywhere, loopback = (
        re.sub('<!--.*?-->', '', resource('config', name).read_text(), flags=re.DOTALL)
        for name in ('fastdds.xml', 'fastdds_loopback.xml')
    )
    listed = re.search(r'\s*<interfaceWhiteList>.*</interfaceWhiteList>', loopback, re.DOTALL)
    assert listed is not None
    assert re.findall('<address>(.*)</address>', listed[0]) == ['127.0.0.1']
    assert loopback.replace(listed[0], '') == everywhere


def test_messages_during_a_pause_of_a_new_process_fit_into_its_queue() -> None:
    # Fast DDS lets it sleep for a third of that time, where it first writes to one that is idle.
    profile = resource('config', 'fastdds.xml').read_text()
    numbers = dict(re.findall(r'<(healthy_check_timeout_ms|port_queue_capacity)>(\d+)<', profile))
    asleep = 1e-3 * int(numbers['healthy_check_timeout_ms']) / 3.0
    assert int(numbers['port_queue_capacity']) > 7 * 1000.0 * asleep  # a recorder's busiest bag


class UdpSocket:
    """A line of /proc/net/udp."""

    def __init__(self, line: str) -> None:
        fields = line.split()
        host, port = fields[1].split(':')
        self.address = '.'.join(str(byte) for byte in bytes.fromhex(host)[::-1])
        self.port = int(port, 16)
        self.unread = int(fields[4].split(':')[1], 16)
        self.inode = fields[9]


def udp_sockets(pid: int) -> list[UdpSocket]:
    """Return the UDP sockets of a process, over IPv4; there are none over IPv6."""
    open_files = []
    for file in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(OSError):  # it was closed meanwhile
            open_files.append(os.readlink(file))
    found = []
    for table in ('udp', 'udp6'):
        lines = (Path('/proc/net') / table).read_text().splitlines()[1:]
        sockets = [UdpSocket(line) for line in lines]
        found.append([x for x in sockets if f'socket:[{x.inode}]' in open_files])
    assert found[1] == []
    return found[0]


def unread_after(pid: int, sockets: list[UdpSocket], patience: float) -> dict[int, int]:
    """Send a datagram to each socket; return the unread ones by port, at the latest after [s]."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for one in sockets:
            sender.sendto(b'RTPS-like', ('127.0.0.1', one.port))
    deadline = time.monotonic() + patience
    while True:
        ports = {x.port for x in sockets}
        unread = {x.port: x.unread for x in udp_sockets(pid) if x.port in ports}
        if not any(unread.values()) or time.monotonic() > deadline:
            return unread
        time.sleep(0.02)


def hears_elsewhere(pid: int, patience: float) -> bool:
    """Return whether a process reads, within [s], datagrams to another address than 127.0.0.1."""
    elsewhere = [x for x in udp_sockets(pid) if x.address != '127.0.0.1' and not x.unread]
    # Fast DDS sends from sockets of all interfaces; those nobody reads.
    at_all = [x for x in elsewhere if x.address == '0.0.0.0']
    read: list[bool] = []
    end = time.monotonic() + patience
    while not any(read) and time.monotonic() < end:
        read += [not unread for unread in unread_after(pid, at_all, 0.3).values()]
    return any(read)


@pytest.fixture
def running_node(
    ros_domain: dict[str, str], tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[NodeProcess]:
    environment = {RANGE: request.param, PROFILES_FILE: ''}
    environment |= {'AERARM_NETWORK': 'open' if request.param == 'SUBNET' else ''}
    node = NodeProcess(
        'fake_hardware', (), {'encoders': 'absolute'}, environment, tmp_path / 'node.log'
    )
    with node:
        deadline = time.monotonic() + 120.0
        while ': idle' not in node.tail():
            assert time.monotonic() < deadline, node.tail()
            time.sleep(0.05)
        yield node


@pytest.mark.parametrize('running_node', [''], indirect=True)  # their own default
def test_by_default_a_node_receives_only_on_the_loopback_interface(
    running_node: NodeProcess, ros_domain: dict[str, str]
) -> None:
    sockets = udp_sockets(running_node.pid)
    assert not hears_elsewhere(running_node.pid, 0.3)
    # Where the nodes of this domain look for each other. The ports that the kernel gives to a
    # sending socket begin at 32768, above the last domain's.
    first = 7400 + 250 * int(ros_domain['ROS_DOMAIN_ID'])
    ports = range(first, first + 100)
    known = [x for x in sockets if x.port in ports]
    assert len(known) >= 2
    assert {x.address for x in known} == {'127.0.0.1'}
    assert not any(unread_after(running_node.pid, known, 10.0).values())
    # A node without the profile is found.
    run = subprocess.run(
        [sys.executable, '-c', PLAIN_NODE],
        env={**os.environ, PROFILES_FILE: ''},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=True,
    )
    assert 'idle' in run.stdout
    assert 'True' in run.stdout


@pytest.mark.parametrize('running_node', ['SUBNET'], indirect=True)
def test_a_node_open_to_the_subnet_receives_on_every_interface(running_node: NodeProcess) -> None:
    assert hears_elsewhere(running_node.pid, 10.0)
