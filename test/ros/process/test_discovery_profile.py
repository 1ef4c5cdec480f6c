import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.ros.process.discovery_profile import PROFILES_FILE, use_packaged_profile
from aerarm_ros.ros.process.node_process import ros_environment

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
    assert ros_environment()[PROFILES_FILE].endswith('config/fastdds.xml')
