"""What every executable does around its node: start, run, end cleanly."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.command_line import CommandLine
from aerarm_ros.ros.process.node_process import (
    find_log_directory,
    stay_on_this_host,
    use_packaged_profile,
)
from aerarm_ros.ros.process.process_end import (
    INTERRUPTED,
    USER_ERROR,
    ExitLimit,
    StopSignals,
    print_error,
    print_notice,
)
from aerarm_ros.ros.process.ros_arguments import RosArguments, UsageError

# The first of these that is set tells ROS where, and without any it does not start.
Result = TypeVar('Result')


class Runnable(Protocol):
    """A node with its own loop.

    Attributes
    ----------
    status
        Exit status once `run` has returned.
    """

    status: int

    def run(self) -> None:
        """Work until the ROS context is shut down."""

    def close(self) -> None:
        """Leave everything safe and destroy the node; called once, whatever happened."""


def run_node(
    name: str,
    create: Callable[[], Runnable],
    args: Sequence[str] | None = None,
    parameters: ParameterTable | None = None,
    description: str | None = None,
) -> int:
    """Create a node, run it, close it, and return the exit status.

    SIGINT, SIGTERM, SIGHUP and a shutdown from outside are ordinary ends (0), however many they
    are, and so is a request for help, which starts nothing. A node that had something to do and
    was interrupted before ends with 130; while the command line is read KeyboardInterrupt comes
    out of here, as nobody knows yet what it would do. An argument or parameter that the node does
    not have is one line on standard error (2), and so is what else a user can repair (a
    parameter's value, a file: ValueError while creating, OSError at any time; 1). Anything else is
    a defect and keeps its traceback.

    Parameters
    ----------
    name
        Executable, for error messages.
    create
        Makes the node; rclpy is initialised by then.
    args
        Command line with ROS arguments, by default the process's own.
    parameters
        The node's parameters; without them the caller has looked at the command line.
    description
        What the node does, for the help.
    """
    interruption = _Interruption()
    with StopSignals(interruption.ask):
        if parameters is not None:
            command_line = CommandLine(name, parameters, description)
            status = interruption.during(lambda: _read_command_line(command_line, args))
            if status is not None:
                return status
        if not _may_start(name):
            return USER_ERROR
        return _run_node(name, create, args, interruption)


class _Interruption:
    """Ends what may be interrupted, and only notes a signal at all other times.

    An exception inside a constructor would be swallowed by the extension modules that are
    imported there, and inside `close` it would leave half of it undone.
    """

    def __init__(self) -> None:
        self.is_asked = False
        self._is_let_in = False

    def ask(self) -> None:
        """Take a stop signal; raises KeyboardInterrupt inside `during`."""
        self.is_asked = True
        if self._is_let_in:
            raise KeyboardInterrupt

    def during(self, action: Callable[[], Result]) -> Result:
        """Return what a function returns; raises KeyboardInterrupt when a signal comes or has."""
        try:
            self._is_let_in = True
            if self.is_asked:
                raise KeyboardInterrupt
            return action()
        finally:
            self._is_let_in = False


def _run_node(
    name: str,
    create: Callable[[], Runnable],
    args: Sequence[str] | None,
    interruption: _Interruption,
) -> int:
    node = None
    try:
        use_packaged_profile()
        find_log_directory()
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = create()
        except ValueError as error:
            return _report(name, error)
        interruption.during(node.run)
    except KeyboardInterrupt:
        if node is not None and node.status:  # it had something to do
            node.status = INTERRUPTED
            print_error(name, 'interrupted before the task was complete')
    except ExternalShutdownException:
        pass
    except (RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        return _report(name, error, USER_ERROR)
    except OSError as error:
        if node is not None:
            node.status = 1
        return _report(name, error)
    except (RCLError, InvalidHandle) as error:
        # A shutdown from outside takes the context away under whatever call is going on.
        if node is None:
            return _report(name, error)
        if rclpy.ok():
            raise
    finally:
        with ExitLimit(1 if node is None or sys.exception() else node.status):
            try:
                if node is not None:
                    node.close()
            finally:
                rclpy.try_shutdown()
    return node.status if node is not None else 0


def _may_start(name: str) -> bool:
    """Prepare the environment of ROS; return whether it can be used."""
    try:
        notice = stay_on_this_host()
    except ValueError as error:
        print_error(name, error)
        return False
    if notice:
        print_notice(name, notice)
    return True


def _read_command_line(command_line: CommandLine, args: Sequence[str] | None) -> int | None:
    """Answer a command line that starts no node; return its exit status, None if one shall."""
    name = command_line.name
    command_line.complete()
    try:
        arguments = RosArguments(sys.argv[1:] if args is None else args)
        if command_line.asks_help(arguments):
            _print_help(command_line.help())
            return 0
        for warning in command_line.check(arguments):
            print(f'{name}: warning: {warning}', file=sys.stderr, flush=True)
    except UsageError as error:
        return _report(name, error, USER_ERROR)
    return None


def _print_help(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:  # whoever reads it, such as head, has seen enough
        # Python flushes once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _report(name: str, error: Exception, status: int = 1) -> int:
    print_error(name, error)
    return status
