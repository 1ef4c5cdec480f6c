"""One line per phase in a log, one updated line on a terminal."""

import io

from aerarm_ros.ros.diagnostics import PATIENCE, REPETITION, WaitingNotice
from aerarm_ros.ros.process.process_end import ProgressLine

SECOND = 1_000_000_000


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def show_three_phases(stream: io.StringIO) -> str:
    progress = ProgressLine('name', stream)
    for now in range(0, 3 * SECOND, SECOND // 20):
        if progress.due(now, f'phase {now // SECOND}'):
            progress.show(f'{now / SECOND:.2f}')
    progress.close()
    return stream.getvalue()


def test_a_log_gets_a_line_a_phase_and_a_terminal_ten_a_second() -> None:
    assert show_three_phases(io.StringIO()) == 'name: 0.00\nname: 1.00\nname: 2.00\n'
    assert show_three_phases(Terminal()).count('\r') == 30


def test_a_terminal_line_is_rewritten_and_leaves_nothing_behind() -> None:
    stream = Terminal()
    progress = ProgressLine('name', stream)
    progress.close()
    assert stream.getvalue() == ''
    progress.show('a long line')
    progress.show('short')
    progress.close()
    assert stream.getvalue() == '\rname: a long line' + '\rname: short      ' + '\n'


def test_a_long_wait_is_reported_and_repeated() -> None:
    notice = WaitingNotice(10.0)
    assert notice.update([], 100.0) == ''
    said = {time: notice.update(['a', 'b'], time) for time in (10.0, 11.9, 12.0, 16.9, 17.0)}
    assert said == {
        10.0: '',
        10.0 + PATIENCE - 0.1: '',
        10.0 + PATIENCE: 'waiting: a; b',
        10.0 + PATIENCE + REPETITION - 0.1: '',
        10.0 + PATIENCE + REPETITION: 'waiting: a; b',
    }
