import json
import os
import time

import pytest

from aerarm_ros.hardware.boards.kept_zeros import ZeroFile, sealed
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.heat_watch import KeptHeat


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'new' / 'arm.json'


def until(condition):
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def begun(rig):
    """Run the rig's bridge on the host's clock."""
    rig.now = time.monotonic()
    rig.boards._now = None
    rig.bridge = BridgeCycle(rig.config, rig.boards, robot=rig.robot)
    rig.bridge.zeros.found()
    rig.run(0.01)
    return rig


def write(path, rig):
    """Write the zeros of the rig's bridge."""
    file = ZeroFile(path, rig.config)
    assert file.read(rig.now) is None
    file.update(rig.bridge, rig.now)
    file.close()


def test_zeros_are_written_once_a_second_and_when_one_changes(path, make_rig):
    rig = begun(make_rig())
    file = ZeroFile(path, rig.config)
    assert file.read(rig.now) is None
    file.update(rig.bridge, 0.0)
    until(path.exists)
    first = path.read_text()
    rig.run(0.01)
    file.update(rig.bridge, 0.9)
    rig.bridge.zeros.lose([0], 'a jump')
    file.update(rig.bridge, 0.91)
    until(lambda: path.read_text() != first)
    names = [j['name'] for b in contents(path)['boards'] for j in b['joints']]
    assert names == ['joint2', 'joint3', 'joint4']
    second = path.read_text()
    rig.run(0.01)
    file.update(rig.bridge, 1.92)
    file.close()
    assert path.read_text() != second
    assert list(path.parent.iterdir()) == [path]


def contents(path):
    """Return the file's content without its digest."""
    return json.loads(json.loads(path.read_text())['kept'])


def changed(text, old, new):
    """Return a changed file with a valid digest."""
    return sealed(json.loads(text)['kept'].replace(old, new))


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [
        (lambda text: text[:-20], 'is incomplete'),
        (lambda text: text.replace('zero\\": ', 'zero\\": 1', 1), 'is incomplete'),
        (lambda text: changed(text, '"arm": "', '"arm": "0'), 'belongs to another arm'),
        (lambda text: b'\xff\xfe', 'is not a text'),
        (lambda text: changed(text, '"windings": [', '"windings": ["x", '), 'is incomplete'),
        (lambda text: changed(text, '"heat": {', '"heat": 5, "old": {'), 'is incomplete'),
    ],
)
def test_a_bad_file_gives_unknown_zeros_and_one_warning(path, make_rig, spoil, reason):
    rig = begun(make_rig())
    write(path, rig)
    spoiled = spoil(path.read_text())
    path.write_bytes(spoiled if isinstance(spoiled, bytes) else spoiled.encode())
    kept = ZeroFile(path, rig.config).read(rig.now)
    assert kept.startswith(f'the state file {path} cannot be used, because ')
    assert reason in kept
    rig.bridge = BridgeCycle(rig.config, rig.boards, robot=rig.robot, kept=kept)
    rig.run(0.02)
    assert rig.bridge.mode == 'unhomed'
    assert [text.count(reason) for text in rig.bridge.faults] == [1]
    assert "then run 'arm home'" in rig.bridge.faults[0]


@pytest.mark.parametrize(('away', 'least', 'most'), [(1.0, 100.0, 108.0), (86400.0, 60.0, 60.0)])
def test_the_next_bridge_knows_how_warm_the_motors_are(path, make_rig, away, least, most):
    rig = begun(make_rig())
    for limit in rig.bridge.heat.limits:
        limit.motor.winding, limit.motor.housing = 108.0, 80.0
    write(path, rig)
    kept = ZeroFile(path, rig.config).read(rig.now)
    assert [board.name for board in kept.boards] == ['board0', 'board1']
    bridge = BridgeCycle(rig.config, rig.boards, robot=rig.robot, kept=kept)
    bridge.heat.recall(kept.heat, rig.now + away)
    for limit in bridge.heat.limits:
        assert least <= limit.motor.winding <= most
    assert ('has cooled to' in bridge.heat.refusal()) == (away < 60.0)
    rig.bridge = bridge
    rig.run(0.02)
    assert bridge.mode == 'idle'
    # No file keeps an arm off for ever.
    bridge.heat.recall(KeptHeat(rig.now, (1e9,), (1e9,)), rig.now)
    assert bridge.heat.limits[0].motor.winding < 150.0


def test_no_file_and_one_that_cannot_be_written(tmp_path, make_rig):
    rig = begun(make_rig())
    none = ZeroFile(None, rig.config)
    assert none.read(rig.now) is None
    none.update(rig.bridge, rig.now)
    none.close()
    (tmp_path / 'file').touch()
    file = ZeroFile(tmp_path / 'file' / 'arm.json', rig.config)
    assert 'cannot be used' in file.read(rig.now)
    file.update(rig.bridge, rig.now)
    file.close()
    assert 'cannot be written' in file.problem


def test_a_pipe_or_device_is_not_read(tmp_path, config):
    pipe = tmp_path / 'arm.json'
    os.mkfifo(pipe)
    assert 'the path is not a regular file' in ZeroFile(pipe, config).read(time.monotonic())
    endless = tmp_path / 'endless.json'
    endless.write_text('[' * 10_000_000)
    assert 'is incomplete' in ZeroFile(endless, config).read(time.monotonic())
