"""Exit status of a process, signals that end the process, and a time limit for its end.

Fast DDS announces its end when a node is destroyed, or else in an exit handler of the C library.
The exit handler may never return (docs/decisions.md, 70). At that time Python and its signal
handlers have ended or wait in C code, so a timer of the C library enforces the limit.

A node that drives motors must finish its cycle and leave the boards safe. rclpy's signal handlers
invalidate the context first, so publishing fails. Python's handlers raise KeyboardInterrupt in the
middle of an exchange. SIGHUP (terminal closed, ssh connection lost), SIGQUIT, SIGXCPU (limit of a
real-time process) and a dozen others would end the process at once.

A process cannot catch SIGKILL. A Python process cannot handle SIGSEGV, SIGBUS, SIGFPE and SIGILL
either: Python's handlers run after the faulty instruction, which never ends. Nor can a process
survive abort().
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType
from typing import Any, ClassVar, TextIO

USER_ERROR = 2  # the user's request is invalid
INTERRUPTED = 130  # ended by Ctrl-C, as in shells


def print_error(name: str, error: object) -> None:
    """Print the executable's name and an error on one line of standard error."""
    if isinstance(error, OSError) and error.filename is not None:
        error = f'{error.filename}: {error.strerror}: check the path and its permissions'
    _print(f'{name}: {" ".join(str(error).split())}', sys.stderr)


def print_notice(name: str, *notices: str) -> None:
    """Print each notice on one line of standard error; a closed stream is no error."""
    for notice in notices:
        _print(f'{name}: {notice}', sys.stderr)


def print_answer(answer: str) -> None:
    """Print a result on standard output; a closed stream is no error."""
    _print(answer, sys.stdout)


def _print(text: str, stream: TextIO) -> None:
    try:
        print(text, file=stream, flush=True)
    except OSError:
        # The terminal is closed. Python would flush again at its end, fail, and exit with 120.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


# [s] of processor time for the end of the process, which needs tenths of a second. Processor time
# leaves a stopped or starved process its full limit.
LIMIT = 10.0
_SIGEV_THREAD = 2  # <bits/sigevent-consts.h>: a thread of the C library calls a function


class _Value(ctypes.Union):
    _fields_ = (('number', ctypes.c_int), ('pointer', ctypes.c_void_p))


class _Event(ctypes.Structure):
    """C structure `sigevent` of <bits/types/sigevent_t.h>, padded to its full size."""

    _fields_ = (
        ('value', _Value),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_char * 32),
    )


class _Times(ctypes.Structure):
    """C structure `itimerspec` of <bits/types/struct_itimerspec.h>."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every', 'every_ns', 'first', 'first_ns'))


class ExitLimit:
    """Context that ends the process by `_exit` if the context uses too much processor time.

    The entering thread gives up its real-time priority, because other threads could not interrupt
    the thread at that priority. With a C library before glibc 2.34 there is no limit.

    Parameters
    ----------
    status
        Exit status if the limit ends the process.
    limit
        Processor time of all threads inside the context [s], above 0.
    """

    def __init__(self, status: int, limit: float = LIMIT) -> None:
        self._status = status
        self._limit = limit
        self._c = ctypes.CDLL(None)
        self._timer: ctypes.c_void_p | None = None

    def __enter__(self) -> ExitLimit:
        if os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR):
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if not hasattr(self._c, 'timer_create'):  # glibc before 2.34
            return self
        exit_now = ctypes.cast(self._c._exit, ctypes.c_void_p).value
        event = _Event(_Value(number=self._status), notify=_SIGEV_THREAD, function=exit_now)
        timer = ctypes.c_void_p()
        made = self._c.timer_create(
            time.CLOCK_PROCESS_CPUTIME_ID, ctypes.byref(event), ctypes.byref(timer)
        )
        if made == 0:
            seconds = int(self._limit)
            times = _Times(first=seconds, first_ns=int((self._limit - seconds) * 1e9))
            self._c.timer_settime(timer, 0, ctypes.byref(times), None)
            self._timer = timer
        return self

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._c.timer_delete(self._timer)


def exit_within(status: int, limit: float = LIMIT) -> None:
    """Limit the processor time for the end of this process to `limit` [s].

    To be called as the last action. The exit status is `status` if the limit ends the process.
    """
    ExitLimit(status, limit).__enter__()


# Signals from a person or a supervisor; a second one ends the process at once.
_REQUESTS = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)
# Other signals that end a process, unless they have a handler.
_ENDING: tuple[int, ...] = tuple(
    signal.Signals[name]
    for name in (
        *('SIGHUP', 'SIGABRT', 'SIGALRM', 'SIGVTALRM', 'SIGPROF', 'SIGUSR1', 'SIGUSR2'),
        *('SIGXCPU', 'SIGIO', 'SIGPWR', 'SIGSTKFLT', 'SIGSYS', 'SIGTRAP'),
    )
)
_ENDING += tuple(range(signal.SIGRTMIN, signal.SIGRTMAX + 1))
# Signals that stop a process until it is continued: Ctrl-Z, and access from the background.
_FREEZING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
# [s] A terminal and a supervisor may both pass on one Ctrl-C. A second signal within this time
# therefore counts as the same request, while the boards are being switched off.
_SAME = 1.0


class StopSignals:
    """Context in which the first signal that would end the process calls a function.

    A second SIGINT, SIGTERM or SIGQUIT, one second or more after the first, ends the process. A
    second SIGHUP does not end the process, because a closing terminal sends SIGHUP more than once.
    A signal that is already ignored, such as SIGHUP under nohup, or that has another handler, stays
    unchanged.

    Contexts may be nested. A signal received in the inner context counts for the outer one too:
    while a process ends, a further signal calls no function.

    Parameters
    ----------
    on_stop
        Called once in the main thread, between any two instructions. It should set a flag and
        return. Called at once if the outer context has already received a signal.
    stays_awake
        True for a process that Ctrl-Z must not stop, because its boards would let the arm fall.
    is_last
        True if no work follows the context. After the context, the process ignores all signals that
        would end it, as after a call of `ignore`.
    """

    _innermost: ClassVar[StopSignals | None] = None

    def __init__(
        self, on_stop: Callable[[], None], stays_awake: bool = False, is_last: bool = False
    ) -> None:
        self._on_stop = on_stop
        self._stays_awake = stays_awake
        self._is_last = is_last
        self._has_called = False
        self._outer: StopSignals | None = None
        self._outermost = self  # nested contexts share the state of its request
        self._is_asked = False
        self._asked_at: float | None = None  # time of the first signal in _REQUESTS [s, monotonic]
        self._previous: dict[int, object] = {}

    def __enter__(self) -> StopSignals:
        self._outer = StopSignals._innermost
        StopSignals._innermost = self
        if self._outer is not None:
            self._outermost = self._outer._outermost
        unused = [number for number in _ENDING if self._may_take(number)]
        self._previous = {
            number: signal.signal(number, self._handle) for number in (*_REQUESTS, *unused)
        }
        if self._stays_awake:
            self._previous |= {n: signal.signal(n, signal.SIG_IGN) for n in _FREEZING}
        if self._outermost._is_asked and not self._has_called:
            self._call_on_stop()
        return self

    def __exit__(self, *_: object) -> None:
        StopSignals._innermost = self._outer
        if self._is_last:
            self.ignore()
            return
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    @staticmethod
    def ignore() -> None:
        """Ignore all signals that would end the process, because the process ends anyway.

        Python removes its handlers when it ends, and a late signal would then cause an exit status
        of failure.
        """
        for number in (*_REQUESTS, *_ENDING):
            signal.signal(number, signal.SIG_IGN)

    def _may_take(self, number: int) -> bool:
        """Return whether this class may handle a signal, because no other code does."""
        handler = signal.getsignal(number)
        if number == signal.SIGHUP:
            return handler is not signal.SIG_IGN
        outer = self._outer
        return handler is signal.SIG_DFL or (outer is not None and number in outer._previous)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        shared = self._outermost
        if number in _REQUESTS:
            now = time.monotonic()
            if shared._asked_at is None:
                shared._asked_at = now
            elif now - shared._asked_at > _SAME:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)
        if not shared._is_asked:
            shared._is_asked = True
            self._call_on_stop()

    def _call_on_stop(self) -> None:
        self._has_called = True
        self._on_stop()


# A parent that is killed (SIGKILL, out of memory) cannot stop its children, but Linux can. Code
# between fork and exec (`preexec_fn`) is not suitable to request it, because it may hang if the
# parent has threads, as with ROS.
_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>
# Process id of the launch, or other process, that starts a process: set by
# `aerarm_ros/launch_parts.py` and by `NodeProcess`.
LAUNCH_PID = 'AERARM_ROS_LAUNCH_PID'


def die_with_parent(parent: int) -> None:
    """Make Linux send SIGTERM to this process when the thread that started the process ends.

    Parameters
    ----------
    parent
        Expected parent process.

    Raises
    ------
    OSError
        If the system refuses.
    ProcessLookupError
        If `parent` has already ended.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    if os.getppid() != parent:
        raise ProcessLookupError(f'process {parent} has ended')


def die_with_launch() -> None:
    """Make Linux send SIGTERM to this process when its `ros2 launch` ends.

    Launch can end before its processes: by an exception during start, by SIGTERM or SIGQUIT, or if
    it is killed. Without the environment variable `LAUNCH_PID` this function does nothing. It also
    does nothing in a grandchild of launch, because a grandchild ends with its own parent.

    Raises
    ------
    OSError
        If the system refuses.
    SystemExit
        If launch has already ended.
    """
    launch = os.environ.get(LAUNCH_PID, '')
    if not launch.isdigit():
        return
    if os.getppid() == int(launch) or not os.path.exists(f'/proc/{launch}'):
        try:
            die_with_parent(int(launch))
        except ProcessLookupError:
            sys.exit(128 + signal.SIGTERM)


_AGAIN = 1.0  # [s] longer than the removal of unfinished files takes


def run_offline(name: str, run: Callable[[], int]) -> int:
    """Run a program without a node, handle interrupts, and return the exit status.

    Parameters
    ----------
    name : str
        Name of the program, for messages.
    run : callable
        Function to run. An interrupt raises KeyboardInterrupt in the function, even if the shell
        has configured the process to ignore interrupts.
    """
    interrupt = _Interrupt()
    # A shell that starts this program in the background has SIGINT ignored, so set it too.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, interrupt)
    try:
        return run()
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        print(f'{name}: interrupted, no files were written', file=sys.stderr)
        return INTERRUPTED


def without_ros_arguments(arguments: Sequence[str] | None) -> list[str]:
    """Return the command-line arguments without the ROS arguments that a launch file appends."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    while '--ros-args' in given:
        start = given.index('--ros-args')
        end = given.index('--', start) + 1 if '--' in given[start:] else len(given)
        del given[start:end]
    return given


class _Interrupt:
    """Signal handler that raises KeyboardInterrupt for the first signal and ignores later ones."""

    def __init__(self) -> None:
        self._is_interrupted = False

    def __call__(self, number: int, frame: Any) -> None:
        if self._is_interrupted and number != signal.SIGALRM:
            return  # the program is removing unfinished files
        self._is_interrupted = True
        # An exception inside a callback of an extension module or a destructor is lost. So a timer
        # raises it again, unless the program has ended by then.
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        raise KeyboardInterrupt


_INTERVAL_NS = 100_000_000  # [ns] between two updates on a terminal


class ProgressLine:
    """Show a program's progress: one updated line on a terminal, one line per phase in a file.

    Parameters
    ----------
    name : name of the program, at the start of each line.
    stream : output stream; standard output by default.
    """

    def __init__(self, name: str, stream: TextIO | None = None) -> None:
        self._name = name
        self._stream = sys.stdout if stream is None else stream
        self._terminal = self._stream.isatty()
        self._phase: str | None = None
        self._due_ns = 0
        self._width = 0

    def due(self, now_ns: int, phase: str = '') -> bool:
        """Return whether to show a new line at the time `now_ns` [ns]."""
        if phase == self._phase and not (self._terminal and now_ns >= self._due_ns):
            return False
        self._phase = phase
        self._due_ns = now_ns + _INTERVAL_NS
        return True

    def show(self, text: str) -> None:
        """Replace the line on the terminal by `text`; in another stream, append a line."""
        line = f'{self._name}: {text}'
        if self._terminal:
            self._stream.write('\r' + line.ljust(self._width))
            self._width = len(line)
        else:
            self._stream.write(line + '\n')
        self._stream.flush()

    def close(self) -> None:
        """End the line on a terminal with a line break."""
        if self._terminal and self._width:
            self._stream.write('\n')
            self._stream.flush()
            self._width = 0
