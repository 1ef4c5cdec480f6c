"""Command line of a node: its help, and checks of its arguments."""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from inspect import cleandoc

from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.ros_arguments import (
    FILE,
    PARAMETER,
    REMAP,
    GivenParameter,
    RosArguments,
    UsageError,
    complete,
)

_HELP = ('-h', '--help')
# Parameters that every node of rclpy has.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')
# Smallest similarity of a misspelt name. Between node names, only a nearly equal name counts.
_SIMILAR, _NEARLY_SAME = 0.6, 0.8


class CommandLine:
    """Command-line arguments of a node.

    Parameters
    ----------
    name
        Executable, and the node's name without remapping.
    parameters
        The node's parameters.
    description
        Description of the node.
    """

    def __init__(self, name: str, parameters: ParameterTable, description: str | None) -> None:
        self.name = name
        self._parameters = {parameter.name: parameter for parameter in parameters}
        self._description = cleandoc(description or '')

    def asks_help(self, arguments: RosArguments) -> bool:
        """Return whether the arguments only request the help."""
        return any(argument in _HELP for argument in arguments.plain)

    def help(self) -> str:
        """Return the help, as wide as the terminal."""
        width = min(100, shutil.get_terminal_size().columns)
        lines = [
            f'usage: {self.name} [-h] [--ros-args -p NAME:=VALUE ... --params-file FILE]',
            '',
            self._description,
            '',
            'Parameters (those marked live may change while the node runs: ros2 param set):',
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
        """Print completions for a shell: the options of ROS, and parameters after -p."""
        parser = argparse.ArgumentParser(prog=self.name)
        parser.add_argument('--ros-args', action='store_true')
        rules = [f'{name}:=' for name in self._parameters]
        for options, choices in ((PARAMETER, rules), (REMAP, None), ((FILE,), None)):
            parser.add_argument(*options, action='append', choices=choices)
        complete(parser)

    def check(self, arguments: RosArguments) -> list[str]:
        """Return warnings about probable mistakes.

        Raises
        ------
        UsageError
            If an argument is unknown, or the node is given an unknown parameter. An unknown
            parameter in a file's section for all nodes is no error, because it may be another
            node's.
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
        """Check one parameter; return a warning or an empty text, or raise UsageError."""
        if not given.is_for(node):
            if given.source == '-p':
                raise UsageError(
                    f'-p {given.node[1:]}:{given.name} sets a parameter of {given.node}, '
                    f'but this node is {node}'
                )
            return ''
        if self._knows(given.name):
            return ''
        similar = _NEARLY_SAME if given.is_for_any_node else _SIMILAR
        closest = _closest(given.name, list(self._parameters), similar)
        hint = f", did you mean '{closest}'?" if closest else ''
        text = (
            f"unknown parameter '{given.name}' in {given.source}{hint} ({self.name} "
            '--help lists all)'
        )
        if not given.is_for_any_node:
            raise UsageError(text)
        return text if closest else ''

    def _knows(self, name: str) -> bool:
        return name in self._parameters or name in _OF_RCLPY


def _misnamed_sections(given: Sequence[GivenParameter], node: str) -> Iterator[str]:
    """Yield a warning for each file that only names a node with a similar name."""
    for file in dict.fromkeys(p.source for p in given if p.source != '-p'):
        sections = {p.node for p in given if p.source == file and not p.is_for_any_node}
        bases = {section.rpartition('/')[2]: section for section in sections}
        closest = _closest(node.rpartition('/')[2], list(bases), _NEARLY_SAME)
        if closest and closest != node.rpartition('/')[2]:
            yield f'{file} has no section for {node}, only for {bases[closest]}: check the spelling'


def _closest(name: str, known: Sequence[str], cutoff: float) -> str:
    return next(iter(get_close_matches(name, known, n=1, cutoff=cutoff)), '')


def _wrap(text: str, width: int, first: int, following: int) -> str:
    return textwrap.fill(text, width, initial_indent=' ' * first, subsequent_indent=' ' * following)
