"""Stop signals in a separate process: one signal, and a repetition."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

# Signals that come as one of two sides, however long a busy host takes to send them.
AS_ONE = """
from aerarm_ros.ros.process import process_end as stop_signals
stop_signals._SAME = 3600.0
"""
SCRIPT = """
import signal, sys, time
from aerarm_ros.ros.process.process_end import StopSignals
calls = []
with StopSignals(lambda: calls.append(1)):
    print('ready', flush=True)
    for line in sys.stdin:
        print(len(calls), flush=True)
"""
INNER = """
import sys
from aerarm_ros.ros.process.process_end import StopSignals
calls = []
def said(): print(*calls, flush=True)
with StopSignals(lambda: calls.append('outer')):
    with StopSignals(lambda: calls.append('inner')):
        print('ready', flush=True)
        sys.stdin.readline()
    said(), sys.stdin.readline()
    with StopSignals(lambda: calls.append('later')):
        said(), sys.stdin.readline()
    StopSignals.ignore()
    said(), sys.stdin.readline()
"""


class Stopped:
    """A process that counts how often it was asked to stop."""

    def __init__(self, *prefix: str, script: str = SCRIPT) -> None:
        command = [*prefix, sys.executable, '-c', script]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            text=True,
        )  # fmt: skip
        assert self._line() == 'ready'

    def says(self) -> str:
        print(file=self.process.stdin, flush=True)
        return self._line()

    def _line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()


@contextmanager
def running(*prefix: str, script: str = SCRIPT) -> Iterator[Stopped]:
    stopped = Stopped(*prefix, script=script)
    try:
        yield stopped
    finally:
        stopped.process.kill()
        stopped.process.communicate()


ENDING = """
    SIGALRM SIGVTALRM SIGPROF SIGUSR1 SIGUSR2 SIGXCPU SIGIO SIGPWR SIGSTKFLT SIGSYS SIGTRAP
"""
OTHERS = [*ENDING.split(), signal.SIGRTMIN, signal.SIGRTMIN + 5, signal.SIGRTMAX]
HANDLED = 'import signal\nsignal.signal(signal.SIGUSR1, lambda *_: None)\n'
AWAKE = SCRIPT.replace('calls.append(1))', 'calls.append(1), stays_awake=True)')


@pytest.mark.parametrize(
    ('script', 'prefix', 'signals'),
    [
        *((SCRIPT, (), [(name, 1)]) for name in ('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGQUIT')),
        (SCRIPT, (), [('SIGABRT', 1), *((other, 1) for other in OTHERS)]),
        (HANDLED + SCRIPT, (), [('SIGUSR1', 0)]),
        (AWAKE, (), [('SIGTSTP', 0), ('SIGTTIN', 0), ('SIGTTOU', 0), ('SIGTERM', 1)]),
        # As from a terminal and from a supervisor at the same time.
        (AS_ONE + SCRIPT, (), [('SIGINT', 1)] * 3),
        # The end of a session sends its first SIGTERM between them.
        (AS_ONE + SCRIPT, (), [('SIGHUP', 1), ('SIGHUP', 1), ('SIGTERM', 1), ('SIGHUP', 1)]),
        (SCRIPT, ('nohup',), [('SIGHUP', 0), ('SIGTERM', 1)]),
    ],
    ids=[
        *('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGQUIT', 'other signals', 'another handler'),
        *('stays awake', 'doubled Ctrl-C', 'repeated SIGHUP', 'nohup'),
    ],
)
def test_signals_call_the_function_at_most_once(
    script: str, prefix: tuple[str, ...], signals: list[tuple[str | int, int]]
) -> None:
    with running(*prefix, script=script) as stopped:
        for name, calls in signals:
            number = signal.Signals[name] if isinstance(name, str) else name
            stopped.process.send_signal(number)
            assert int(stopped.says()) == calls, name


def test_the_second_ends_the_process() -> None:
    with running() as stopped:
        begin = time.monotonic()
        stopped.process.send_signal(signal.SIGINT)
        assert stopped.says() == '1'
        while stopped.process.poll() is None and time.monotonic() < begin + 10.0:
            stopped.process.send_signal(signal.SIGTERM)
            time.sleep(0.1)
        assert stopped.process.returncode == -signal.SIGTERM
        assert time.monotonic() > begin + 1.0


@pytest.mark.parametrize(
    ('crash', 'number'), [('ctypes.string_at(0)', signal.SIGSEGV), ('os.abort()', signal.SIGABRT)]
)
def test_a_crash_still_ends_the_process(crash: str, number: signal.Signals) -> None:
    # A handler would be called after the instruction that crashed, which is never over.
    script = SCRIPT.replace('for line', f'import ctypes, os; {crash}\n    for line')
    with running(script=script) as stopped:
        assert stopped.process.wait(60.0) == -number


def test_a_signal_in_the_inner_context_reaches_the_outer_one() -> None:
    with running(script=INNER) as stopped:
        for said in ('inner', 'inner later', 'inner later'):
            stopped.process.send_signal(signal.SIGINT)
            assert stopped.says() == said
        stopped.process.send_signal(signal.SIGINT)
        stopped.process.communicate('')
        assert stopped.process.returncode == 0
