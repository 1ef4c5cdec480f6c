"""What every executable does around its node: start, run, end cleanly."""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException

from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.command_line import CommandLine
from aerarm_ros.ros.process.discovery_profile import use_packaged_profile
from aerarm_ros.ros.process.exit_status import USER_ERROR, print_error
from aerarm_ros.ros.process.local_discovery import stay_on_this_host
from aerarm_ros.ros.process.log_directory import find_log_directory
from aerarm_ros.ros.process.ros_arguments import RosArguments, UsageError


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

    SIGINT, SIGTERM and a shutdown from outside are ordinary ends (0), as SIGHUP is for a node
    that runs under StopSignals, and so is a request for help, which starts nothing. An argument
    or parameter that the node does not have is one line on standard error (2), and so is what
    else a user can repair (a parameter's value, a file: ValueError while creating, OSError at
    any time; 1). Anything else is a defect and keeps its traceback.

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
    if parameters is not None:
        status = _read_command_line(CommandLine(name, parameters, description), args)
        if status is not None:
            return status
    stay_on_this_host()
    node = None
    try:
        use_packaged_profile()
        find_log_directory()
        rclpy.init(args=args)
        try:
            node = create()
        except ValueError as error:
            return _report(name, error)
        node.run()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        return _report(name, error, USER_ERROR)
    except OSError as error:
        return _report(name, error)
    except (RCLError, InvalidHandle) as error:
        # A signal shuts the context down under whatever call is going on.
        if node is None:
            return _report(name, error)
        if rclpy.ok():
            raise
    finally:
        try:
            if node is not None:
                node.close()
        finally:
            rclpy.try_shutdown()
    return node.status if node is not None else 0


def _read_command_line(command_line: CommandLine, args: Sequence[str] | None) -> int | None:
    """Answer a command line that starts no node; return its exit status, None if one shall."""
    name = command_line.name
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
