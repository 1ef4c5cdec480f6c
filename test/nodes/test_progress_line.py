"""A line a second in a log, one line rewritten on a terminal."""

import io

from aerarm_ros.nodes.progress_line import ProgressLine

SECOND = 1_000_000_000


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_log_gets_a_line_a_second() -> None:
    stream = io.StringIO()
    progress = ProgressLine('name', stream)
    for now in range(0, 3 * SECOND, SECOND // 20):
        if progress.due(now):
            progress.show(f'{now // SECOND} s')
    progress.close()
    assert stream.getvalue() == 'name: 0 s\nname: 1 s\nname: 2 s\n'


def test_a_terminal_line_is_rewritten_and_leaves_nothing_behind() -> None:
    stream = Terminal()
    progress = ProgressLine('name', stream)
    progress.show('a long line')
    progress.show('short')
    progress.close()
    assert stream.getvalue() == '\rname: a long line' + '\rname: short      ' + '\n'


def test_closing_without_a_line_writes_nothing() -> None:
    stream = Terminal()
    ProgressLine('name', stream).close()
    assert stream.getvalue() == ''
