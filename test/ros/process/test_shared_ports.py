"""The wait of Fast DDS's ports in shared memory: real ports, and files that are none."""

import os
import struct
import time
from pathlib import Path

import pytest
import rclpy

from aerarm_ros.ros.process.shared_ports import WAIT_MS, PortWatch, shorten_wait


def port_file(folder: Path, port: int, check: int = 3000, wait: int = 1000) -> Path:
    """Write a file like a port: the number occurs once more, in front of the fields."""
    path = folder / f'fastrtps_port{port}'
    fields = struct.pack('<IIIIII', port, 1, check, wait, 8192, 0)
    path.write_bytes(struct.pack('<I', port) + bytes(100) + fields + bytes(500))
    return path


def wait_of(path: Path) -> int:
    return struct.unpack_from('<I', path.read_bytes(), 104 + 12)[0]


def test_only_the_wait_changes(tmp_path: Path) -> None:
    path = port_file(tmp_path, 7411)
    before = path.read_bytes()
    assert shorten_wait(path)
    assert wait_of(path) == WAIT_MS
    after = path.read_bytes()
    assert len(after) == len(before)
    assert after[:116] + before[116:120] + after[120:] == before
    assert shorten_wait(path)  # again: nothing left to do
    assert path.read_bytes() == after


@pytest.mark.parametrize(('check', 'wait'), [(3000, 999), (0, 0), (10**9, 333333333)])
def test_another_layout_is_left_alone(tmp_path: Path, check: int, wait: int) -> None:
    path = port_file(tmp_path, 7411, check, wait)
    before = path.read_bytes()
    assert not shorten_wait(path)
    assert path.read_bytes() == before


def test_a_file_that_is_no_port_is_not_opened(tmp_path: Path) -> None:
    assert not shorten_wait(tmp_path / 'fastrtps_port7411_el')
    empty = tmp_path / 'fastrtps_port7411'
    empty.touch()
    assert not shorten_wait(empty)


def until(condition, patience: float = 10.0) -> None:
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_ports_that_exist_and_ports_that_come_are_shortened(tmp_path: Path) -> None:
    old = port_file(tmp_path, 7410)
    with PortWatch(tmp_path):
        until(lambda: wait_of(old) == WAIT_MS)
        new = tmp_path / 'fastrtps_port7412'
        new.touch()  # its owner fills it later
        other = port_file(tmp_path, 7413)
        until(lambda: wait_of(other) == WAIT_MS)
    late = port_file(tmp_path, 7414)
    time.sleep(0.05)
    assert wait_of(late) == 1000


@pytest.mark.skipif(not Path('/dev/shm').is_dir(), reason='no shared memory folder: Linux only')
def test_the_ports_of_a_real_participant_are_found(ros_node: rclpy.node.Node) -> None:
    maps = Path('/proc/self/maps').read_text()
    ports = {
        Path(line.split()[-1])
        for line in maps.splitlines()
        if '/fastrtps_port' in line and not line.endswith(('_el', '_sl'))
    }
    assert ports, 'this node uses no shared memory'
    assert all(shorten_wait(path) for path in ports if path.exists() and os.access(path, os.W_OK))
