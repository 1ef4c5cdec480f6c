"""Check the command line of an executable, then create, run and close its node."""

from __future__ import annotations

import argparse
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from inspect import cleandoc
from typing import Protocol, TypeVar

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from aerarm_ros.ros.parameters.parameter_table import ParameterTable
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
    print_answer,
    print_error,
    print_notice,
)
from aerarm_ros.ros.process.ros_arguments import (
    FILE,
    PARAMETER,
    REMAP,
    GivenParameter,
    RosArguments,
    UsageError,
    complete,
)

# Parameters that every node of rclpy has.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')
# Smallest similarity of a misspelt name to a known one; node names must be more similar.
_SIMILAR, _NEARLY_SAME = 0.6, 0.8


class CommandLine:
    """Check a node's command line, and print its help and completions.

    Parameters
    ----------
    name
        Name of the executable, and of the node before remapping.
    parameters
        Parameters of the node.
    description
        Description of the node for the help.
    """

    def __init__(self, name: str, parameters: ParameterTable, description: str | None) -> None:
        self.name = name
        self._parameters = {parameter.name: parameter for parameter in parameters}
        self._description = cleandoc(description or '')

    def help(self) -> str:
        """Return the text for --help, wrapped to the width of the terminal."""
        width = min(100, shutil.get_terminal_size().columns)
        lines = [
            f'usage: {self.name} [-h] [--ros-args -p NAME:=VALUE ... --params-file FILE]',
            '',
            self._description,
            '',
            'Parameters (`arm set` changes those marked live while the node runs):',
        ]
        parameters = list(self._parameters.values())
        groups = dict.fromkeys(['', *(parameter.group for parameter in parameters)])
        for group in groups:
            lines += ['', f'{group}:'] if group else []
            for parameter in parameters:
                if parameter.group == group:
                    lines.append(_wrap(parameter.heading(), width, 2, 6))
                    lines.append(_wrap(parameter.description, width, 6, 6))
        return '\n'.join(lines)

    def complete(self) -> None:
        """Print completions for the shell: ROS options, and parameter names after -p."""
        parser = argparse.ArgumentParser(prog=self.name)
        parser.add_argument('--ros-args', action='store_true')
        rules = [f'{name}:=' for name in self._parameters]
        for options, choices in ((PARAMETER, rules), (REMAP, None), ((FILE,), None)):
            parser.add_argument(*options, action='append', choices=choices)
        complete(parser)

    def check(self, arguments: RosArguments) -> list[str]:
        """Return warnings about probably misspelt parameter and node names.

        Raises
        ------
        UsageError
            If an argument or a parameter is unknown. An unknown parameter in a file's section for
            all nodes is no error, because it may be a parameter of another node.
        """
        if arguments.plain:
            raise UsageError(
                f"unknown argument '{arguments.plain[0]}': set parameters with --ros-args -p "
                f'NAME:=VALUE, see {self.name} --help'
            )
        node = arguments.full_name(self.name)
        warnings = [self._judge(given, node) for given in arguments.parameters]
        return [*filter(None, warnings), *_misnamed_sections(arguments.parameters, node)]

    def _judge(self, given: GivenParameter, node: str) -> str:
        """Return a warning about a given parameter, or an empty string; raises UsageError."""
        if not given.is_for(node):
            if given.source == '-p':
                raise UsageError(
                    f'-p {given.node[1:]}:{given.name} sets a parameter of the node '
                    f'{given.node}, but the name of this node is {node}: correct the node name'
                )
            return ''
        if given.name in self._parameters or given.name in _OF_RCLPY:
            return ''
        similar = _NEARLY_SAME if given.is_for_any_node else _SIMILAR
        closest = _closest(given.name, list(self._parameters), similar)
        hint = f", did you mean '{closest}'?" if closest else ''
        text = (
            f"unknown parameter '{given.name}' in {given.source}{hint} ({self.name} "
            '--help lists all parameters)'
        )
        if not given.is_for_any_node:
            raise UsageError(text)
        return text if closest else ''


def _misnamed_sections(given: Sequence[GivenParameter], node: str) -> Iterator[str]:
    """Yield a warning for each parameter file whose section name is probably misspelt."""
    for file in dict.fromkeys(p.source for p in given if p.source != '-p'):
        sections = {p.node for p in given if p.source == file and not p.is_for_any_node}
        bases = {section.rpartition('/')[2]: section for section in sections}
        closest = _closest(node.rpartition('/')[2], list(bases), _NEARLY_SAME)
        if closest and closest != node.rpartition('/')[2]:
            yield (
                f'parameter file {file} has no section for the node {node}, only for '
                f'{bases[closest]}: check the spelling'
            )


def _closest(name: str, known: Sequence[str], cutoff: float) -> str:
    return next(iter(get_close_matches(name, known, n=1, cutoff=cutoff)), '')


def _wrap(text: str, width: int, first: int, following: int) -> str:
    return textwrap.fill(text, width, initial_indent=' ' * first, subsequent_indent=' ' * following)


Result = TypeVar('Result')


class Runnable(Protocol):
    """Interface of a node that `run_node` can run.

    Attributes
    ----------
    status
        Exit status of the process once `run` has returned.
    """

    status: int

    def run(self) -> None:
        """Run the node until its task is complete or the ROS context is shut down."""

    def close(self) -> None:
        """Leave the hardware safe and destroy the node; `run_node` always calls it once."""


def run_node(
    name: str,
    create: Callable[[], Runnable],
    args: Sequence[str] | None = None,
    parameters: ParameterTable | None = None,
    description: str | None = None,
) -> int:
    """Create a node, run and close it, and return the exit status of the process.

    The exit status is 0 after SIGINT, SIGTERM, SIGHUP, an external shutdown or a request for help.
    It is 130 if a task was interrupted before its end. While the command line is read, an interrupt
    raises KeyboardInterrupt, because the kind of program is not known yet. The exit status is 2 for
    an unknown argument or parameter. It is 1 for any other problem that a user can solve, such as
    an invalid parameter value or file (ValueError during creation, OSError at any time). Each such
    problem is printed as one line on standard error. Any other exception is a defect and keeps its
    traceback.

    Parameters
    ----------
    name
        Name of the executable for error messages.
    create
        Function that creates the node; called after `rclpy.init`.
    args
        Command line with ROS arguments, by default that of this process.
    parameters
        Parameters of the node. Without them the command line is not checked.
    description
        Description of the node for the help.
    """
    interruption = _Interruption()
    with StopSignals(interruption.request):
        if parameters is not None:
            command_line = CommandLine(name, parameters, description)
            status = interruption.during(lambda: _read_command_line(command_line, args))
            if status is not None:
                return status
        try:
            print_notice(name, *filter(None, [stay_on_this_host()]))
        except ValueError as error:
            return _report(name, error, USER_ERROR)
        return _run_node(name, create, args, interruption)


class _Interruption:
    """Convert a stop signal to KeyboardInterrupt, but only during interruptible work.

    A constructor is not interruptible, because the extension modules that it imports can swallow
    an exception. `close` is not interruptible either, because it would remain incomplete.
    """

    def __init__(self) -> None:
        self._is_requested = False
        self._is_permitted = False

    def request(self) -> None:
        """Store a stop signal, and raise KeyboardInterrupt while `during` runs an action."""
        self._is_requested = True
        if self._is_permitted:
            raise KeyboardInterrupt

    def during(self, action: Callable[[], Result]) -> Result:
        """Return the result of `action`; an earlier or new stop signal raises KeyboardInterrupt."""
        try:
            self._is_permitted = True
            if self._is_requested:
                raise KeyboardInterrupt
            return action()
        finally:
            self._is_permitted = False


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
        if node is not None and node.status:  # the node had a task to finish
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
        # An external shutdown invalidates the context during any call.
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


def _read_command_line(command_line: CommandLine, args: Sequence[str] | None) -> int | None:
    """Check the command line, or print help or completions.

    Return None if the node may start, otherwise the exit status of the process.
    """
    name = command_line.name
    command_line.complete()
    try:
        arguments = RosArguments(sys.argv[1:] if args is None else args)
        if set(arguments.plain) & {'-h', '--help'}:
            print_answer(command_line.help())
            return 0
        for warning in command_line.check(arguments):
            print(f'{name}: warning: {warning}', file=sys.stderr, flush=True)
    except UsageError as error:
        return _report(name, error, USER_ERROR)
    return None


def _report(name: str, error: Exception, status: int = 1) -> int:
    print_error(name, error)
    return status
