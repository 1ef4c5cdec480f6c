"""The real py-spidev down to the system calls, which a preloaded shim answers."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
import spi_boards
from spi_boards import SpiBoards

from aerarm_ros.description.resources import resource

DEVICES = ('/dev/spidev0.0', '/dev/spidev0.1')
COUNT = 100


@pytest.fixture(scope='module')
def server() -> Iterator[SpiBoards]:
    if spi_boards.missing():
        pytest.skip(spi_boards.missing())
    with SpiBoards() as boards:
        yield boards


@pytest.fixture
def boards(server: SpiBoards) -> SpiBoards:
    """Return boards without faults on working devices."""
    for number, device in enumerate(DEVICES):
        server.come_back(device)
        server.set(device, working_mode=0, eio=False, length_max=1000, transfers=0)
        server.inject(f'power_cycle:{number}')
    return server


def use(
    boards: SpiBoards,
    in_between: Callable[[], None] | None = None,
    config: str = '',
    at_end: Callable[[], None] | None = None,
) -> dict:
    """Let a process exchange frames, act, and exchange as many again; return its report.

    With an action at the end, the process continues until every board answers.
    """
    command = [sys.executable, spi_boards.HERE / 'spi_client.py', config, str(COUNT)]
    if at_end:
        command.append('20')
    with subprocess.Popen(
        command,
        env={**os.environ, **boards.environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        line = process.stdout.readline()
        if line.strip() != 'half':
            return json.loads(line)
        if in_between:
            in_between()
        if at_end:
            print(file=process.stdin, flush=True)
            assert process.stdout.readline().strip() == 'end'
            at_end()
        return json.loads(process.communicate('\n')[0])


def test_frames_pass_both_ways_with_the_configured_clock_and_mode(boards):
    report = use(boards)
    assert report['before']['good'] == report['after']['good'] == [COUNT, COUNT]
    # A board answers with the frame that was ready before it read the command.
    assert report['after']['index'] == [COUNT - 1, COUNT - 1]
    assert report['after']['problems'] == ['', '']
    for answer, board in zip(report['self_test'], boards.report(), strict=True):
        assert answer[0], answer
        assert '50 of 50 answers had a correct check' in answer[1]
        assert (board['mode'], board['speed']) == (0, 8_000_000)
        assert board['transfers'] == 50 + 2 * COUNT
        assert not board['enabled']


def test_a_board_of_the_other_mode_is_found_by_the_self_test(boards):
    boards.set(DEVICES[1], working_mode=1)
    report = use(boards)
    assert report['self_test'][0][0]
    assert not report['self_test'][1][0]
    assert 'but mode 1 works: set the key mode of this board to 1' in report['self_test'][1][1]
    assert report['before']['good'] == [COUNT, 0]
    assert boards.report()[1]['mode'] == 0


def test_errors_of_one_device_are_its_bad_frames_alone(boards):
    def fail():
        boards.set(DEVICES[0], eio=True)
        boards.set(DEVICES[1], length_max=20)

    def recover():
        boards.set(DEVICES[0], eio=False)
        boards.set(DEVICES[1], length_max=1000)

    report = use(boards, fail, at_end=recover)
    assert report['before']['good'] == [COUNT, COUNT]
    assert report['after']['good'] == [0, 0]
    assert '/dev/spidev0.0 reports an error (Input/output error)' in report['after']['problems'][0]
    assert report['later']['good'] == [1, 1]


def test_bit_errors_are_bad_frames_and_lost_commands(boards):
    report = use(boards, lambda: boards.inject('bit_errors:0:0:0.2'))
    assert 60 < report['after']['good'][0] < 95
    assert report['after']['good'][1] == COUNT


def test_a_vanished_device_cannot_be_opened(boards):
    boards.vanish(DEVICES[0])
    error = use(boards)['error']
    assert error.startswith('/dev/spidev0.0 of board0 cannot be opened (No such file or directory)')


def test_a_device_that_comes_back_is_opened_again_with_its_mode_and_clock(boards, tmp_path):
    text = resource('config', 'aerarm.yaml').read_text()
    path = tmp_path / 'arm.yaml'
    path.write_text(text.replace('mode: 0', 'mode: 1').replace('8000000', '4000000'))
    boards.set(DEVICES[0], working_mode=1)
    boards.set(DEVICES[1], working_mode=1)
    report = use(
        boards, lambda: boards.vanish(DEVICES[0]), str(path), lambda: boards.come_back(DEVICES[0])
    )
    assert report['before']['good'] == [COUNT, COUNT]
    assert report['after']['good'] == [0, COUNT]
    assert max(report['after']['slowest']) < 1.0
    assert 'tries to open the device again' in report['after']['problems'][0]
    assert report['later']['good'] == [1, 1]
    assert report['later']['problems'] == ['', '']
    assert [(b['mode'], b['speed']) for b in boards.report()] == [(1, 4_000_000)] * 2
