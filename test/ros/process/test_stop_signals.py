"""Stop signals in a separate process: one signal, and a repetition."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator

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

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def calls(self) -> int:
        return int(self.says())

    def says(self) -> str:
        print(file=self.process.stdin, flush=True)
        return self._line()

    def _line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()


@pytest.fixture
def stopped() -> Iterator[Stopped]:
    stopped = Stopped()
    yield stopped
    end(stopped)


def end(stopped: Stopped) -> None:
    stopped.process.kill()
    stopped.process.communicate()


@pytest.mark.parametrize(
    'number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGABRT]
)
def test_each_stop_signal_calls_the_function_once(stopped: Stopped, number: signal.Signals) -> None:
    stopped.send(number)
    assert stopped.calls() == 1


def test_the_second_ends_the_process(stopped: Stopped) -> None:
    begin = time.monotonic()
    stopped.send(signal.SIGINT)
    assert stopped.calls() == 1
    while stopped.process.poll() is None and time.monotonic() < begin + 10.0:
        stopped.send(signal.SIGTERM)
        time.sleep(0.1)
    assert stopped.process.returncode == -signal.SIGTERM
    assert time.monotonic() > begin + 1.0


ENDING = """
    SIGALRM SIGVTALRM SIGPROF SIGUSR1 SIGUSR2 SIGXCPU SIGIO SIGPWR SIGSTKFLT SIGSYS SIGTRAP
"""


def test_other_ending_signals_call_the_function_once(stopped: Stopped) -> None:
    numbers = [signal.Signals[name] for name in ENDING.split()]
    for number in (*numbers, signal.SIGRTMIN, signal.SIGRTMIN + 5, signal.SIGRTMAX):
        stopped.send(number)
        assert stopped.calls() == 1, number


def test_a_signal_with_another_handler_is_unchanged() -> None:
    use = 'import signal\nsignal.signal(signal.SIGUSR1, lambda *_: None)\n'
    stopped = Stopped(script=use + SCRIPT)
    stopped.send(signal.SIGUSR1)
    assert stopped.calls() == 0
    end(stopped)


def test_one_that_stays_awake_is_not_stopped_by_ctrl_z() -> None:
    script = SCRIPT.replace('calls.append(1))', 'calls.append(1), stays_awake=True)')
    stopped = Stopped(script=script)
    for number in (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU):
        stopped.send(number)
        assert stopped.calls() == 0
    stopped.send(signal.SIGTERM)
    assert stopped.calls() == 1
    end(stopped)


def test_a_crash_still_ends_the_process() -> None:
    # A handler would be called after the instruction that crashed, which is never over.
    for crash, number in (('ctypes.string_at(0)', signal.SIGSEGV), ('os.abort()', signal.SIGABRT)):
        script = SCRIPT.replace('for line', f'import ctypes, os; {crash}\n    for line')
        stopped = Stopped(script=script)
        assert stopped.process.wait(60.0) == -number
        end(stopped)


def test_a_doubled_ctrl_c_calls_the_function_once() -> None:
    stopped = Stopped(script=AS_ONE + SCRIPT)
    # As from a terminal and from a supervisor at the same time.
    for _ in range(3):
        stopped.send(signal.SIGINT)
    assert stopped.calls() == 1
    end(stopped)


def test_repeated_sighup_calls_the_function_once() -> None:
    stopped = Stopped(script=AS_ONE + SCRIPT)
    for _ in range(3):
        stopped.send(signal.SIGHUP)
        assert stopped.calls() == 1
    # As when the session is ended: that is the first SIGTERM.
    stopped.send(signal.SIGTERM)
    assert stopped.calls() == 1
    stopped.send(signal.SIGHUP)
    assert stopped.calls() == 1
    end(stopped)


def test_nohup_is_respected() -> None:
    stopped = Stopped('nohup')
    stopped.send(signal.SIGHUP)
    assert stopped.calls() == 0
    stopped.send(signal.SIGTERM)
    assert stopped.calls() == 1
    end(stopped)


def test_a_signal_in_the_inner_context_reaches_the_outer_one() -> None:
    stopped = Stopped(script=INNER)
    for said in ('inner', 'inner later', 'inner later'):
        stopped.send(signal.SIGINT)
        assert stopped.says() == said
    stopped.send(signal.SIGINT)
    stopped.process.communicate('')
    assert stopped.process.returncode == 0
