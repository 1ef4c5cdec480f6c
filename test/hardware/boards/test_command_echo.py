import numpy as np
import pytest

from aerarm_ros.hardware.boards.board_monitor import CommandEcho
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

SETTINGS = BridgeSettings(lost_commands_max=4, lost_commands_warning=0.05)


class Wires:
    """A board behind two wires, and a host that sends a command in each exchange."""

    def __init__(self, echoes=True, start=0):
        self.echo = CommandEcho('board0', SETTINGS, echoes)
        self.sent = self.used = start
        self.echo.answered(start, start)

    def exchange(self, out=True, back=True):
        """Exchange frames over intact or broken wires."""
        answered = self.used  # the board answers before it reads
        if back:
            self.echo.answered(answered, self.sent)
        else:
            self.echo.missed()
        self.sent = (self.sent + 1) % 0x10000
        if out:
            self.used = self.sent
        return self.echo


@pytest.mark.parametrize('echoes', [True, False])
def test_on_good_wires_and_without_an_index_nothing_is_lost(echoes):
    wires = Wires(echoes)
    for _ in range(50):
        echo = wires.exchange(out=echoes)
    assert (echo.lost, echo.lost_in_row, echo.rate, echo.unconfirmed) == (0, 0, 0.0, 1)
    assert not echo.is_losing
    assert not echo.is_cut
    assert echo.warning == ''


def test_a_lost_command_shows_one_exchange_later():
    wires = Wires()
    wires.exchange(out=False)
    assert wires.echo.lost == 0
    echo = wires.exchange()
    assert (echo.lost, echo.lost_in_row, echo.unconfirmed) == (1, 1, 2)
    assert echo.is_losing
    echo = wires.exchange()
    assert (echo.lost, echo.lost_in_row, echo.unconfirmed) == (1, 0, 1)


def test_lost_commands_in_a_row_are_a_cut_wire():
    wires = Wires()
    for count in range(5):
        assert not wires.echo.is_cut, count
        wires.exchange(out=False)
    assert wires.echo.is_cut
    assert wires.echo.warning == f'board0: {wires.echo.fault}'
    assert wires.echo.fault == (
        '4 consecutive commands did not reach the board over MOSI, although its answers reach '
        'the host: check the MOSI wire, its connector, the ground wire and clock_hz'
    )
    wires.exchange()
    wires.exchange()
    assert not wires.echo.is_cut


@pytest.mark.parametrize('both', [True, False])
def test_lost_answers_are_no_lost_commands_whether_the_command_arrives_or_not(both):
    wires = Wires()
    for whole in (np.random.default_rng(1 + both).random(2000) > 0.5).tolist():
        wires.exchange(out=whole or not both, back=whole)
    assert (wires.echo.lost, wires.echo.rate) == (0, 0.0)
    assert both or wires.echo.lost_in_row == 0


def test_of_commands_lost_between_lost_answers_those_are_counted_that_are_certain():
    wires = Wires()
    wires.exchange()
    wires.exchange(out=False)
    wires.exchange(out=False, back=False)
    assert wires.echo.unconfirmed == 2
    echo = wires.exchange(out=False)
    assert echo.lost == 0
    assert echo.unconfirmed == 3
    assert wires.exchange().lost == 1
    # A command arrived while no answer did: the row has ended.
    wires.exchange(back=False)
    assert wires.exchange().lost_in_row == 0
    for unconfirmed in (2, 3):
        wires.exchange(back=False)
        assert wires.echo.unconfirmed == unconfirmed


@pytest.mark.parametrize('rate', [0.02, 0.2, 0.7])
def test_the_rate_is_the_fraction_of_lost_commands(rate):
    wires = Wires()
    for whole in (np.random.default_rng(3).random(5000) >= rate).tolist():
        wires.exchange(out=whole)
    assert wires.echo.rate == pytest.approx(rate, abs=4.0 * np.sqrt(rate / 2000.0))
    assert wires.echo.lost == pytest.approx(5000 * rate, rel=0.2)
    for _ in range(5):
        wires.exchange()
    is_told = '% of the commands do not reach the board over MOSI' in wires.echo.warning
    assert is_told == (rate > SETTINGS.lost_commands_warning)


def test_the_index_wraps():
    wires = Wires(start=0xFFFE)
    for _ in range(4):
        wires.exchange()
    wires.exchange(out=False)
    assert wires.exchange().unconfirmed == 2
    assert wires.echo.lost == 1
