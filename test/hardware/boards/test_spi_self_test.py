import pytest

from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.transports.spidev_transport import self_test


class ClockedBus:
    """Emulated boards behind wires that work in one SPI mode only; otherwise bits are shifted."""

    def __init__(self, boards, working_mode, share=1.0, problem=''):
        self.boards = boards
        self.working_mode = working_mode
        self.share = share
        self.modes = [0, 0]
        self.exchanges = 0
        self._problem = problem

    def exchange(self, board, frame):
        self.exchanges += 1
        if self._problem:
            return b''
        answer = self.boards.exchange(board, frame)
        lost = (self.exchanges % 10) / 10 >= self.share
        if lost or self.modes[board] != self.working_mode:
            return (int.from_bytes(answer) >> 1).to_bytes(len(answer))
        return answer

    def set_mode(self, board, mode):
        self.modes[board] = mode

    def problem(self, board):
        return self._problem


@pytest.fixture
def try_bus(config, robot):
    def run(**options):
        boards = make_emulated_transport(config, robot, seed=None)
        boards.advance(0.0)
        boards.advance(0.001)
        bus = ClockedBus(boards, **options)
        answers = self_test(bus, config, load_profile(), pause=lambda seconds: None)
        assert bus.modes == [0, 0]
        assert not any(board.system_enabled for board in boards.boards)
        return answers

    return run


@pytest.mark.parametrize('mode', [1, 2, 3])
def test_the_mode_that_works_is_named(try_bus, mode):
    for answer in try_bus(working_mode=mode):
        assert not answer.accepted
        assert f'0 of 50 answers had a correct checksum, but mode {mode} works' in answer.message


def test_bad_wires(try_bus):
    assert 'shorten the cable' in try_bus(working_mode=0, share=0.5)[0].message
    assert 'check the supply' in try_bus(working_mode=7)[1].message
    assert 'Input/output error' in try_bus(working_mode=0, problem='Input/output error')[0].message
