"""Parser for the ROS arguments in a command line; this module imports no ROS."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import yaml

from aerarm_ros.description.config_reader import LOADER, ConfigError, plain_data, read_plain
from aerarm_ros.ros.process.process_end import USER_ERROR


def complete(parser: argparse.ArgumentParser) -> None:
    """Print completions and end the process if a shell requests them; otherwise do nothing."""
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)


class OneLineParser(argparse.ArgumentParser):
    """Argument parser that prints an error as one line with a reference to --help.

    The parser also prints completions if a shell requests them.
    """

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """Parse arguments as `argparse.ArgumentParser.parse_args` does."""
        complete(self)
        return super().parse_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Print the error and end the process."""
        self.exit(USER_ERROR, f'{self.prog}: {message}; see {self.prog} --help\n')


PARAMETER = ('-p', '--param')
REMAP = ('-r', '--remap')
FILE = '--params-file'
_SECTION = 'ros__parameters'
ANY_NODE = '/**'


class _Untagged(LOADER):  # type: ignore[misc]
    """YAML loader that ignores tags, because ROS launch writes the tag `!!python/tuple`."""


def _without_tag(loader: yaml.SafeLoader, _: str, node: yaml.Node) -> object:
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node)
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node)
    assert isinstance(node, yaml.ScalarNode)
    return loader.construct_scalar(node)


_Untagged.add_multi_constructor('', _without_tag)


class UsageError(ValueError):
    """A command-line argument is invalid; the message states valid arguments."""


class GivenParameter(NamedTuple):
    """Parameter that the command line or a parameter file sets.

    Attributes
    ----------
    node
        Full name of the node, or a pattern: ``*`` is one name, ``**`` any number of names.
    name
        Name of the parameter.
    source
        Source of the value: ``-p``, or the name of the parameter file.
    """

    node: str
    name: str
    source: str

    @property
    def is_for_any_node(self) -> bool:
        """Whether a parameter file sets the parameter for all nodes, whatever their names."""
        return self.node.endswith('*') and self.source not in PARAMETER

    def is_for(self, node: str) -> bool:
        """Return whether the parameter applies to the node with the full name `node`."""
        pattern = re.escape(self.node).replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
        return re.fullmatch(pattern, node) is not None


class RosArguments:
    """Split a command line into plain arguments and arguments for ROS.

    Groups of ROS arguments begin with ``--ros-args`` and end with ``--`` or at the end of the line.

    Parameters
    ----------
    arguments
        Command line without the name of the program.

    Attributes
    ----------
    plain : list of str
        Arguments that are not for ROS.
    parameters : list of GivenParameter
        Parameters that the command line and its files set, in the order of the command line.

    Raises
    ------
    UsageError
        If a parameter or its file cannot be read. rclpy reports other errors.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self.plain, groups = _split(arguments)
        self._remaps: list[str] = []
        self.parameters: list[GivenParameter] = []
        for option, value in groups:
            if option in REMAP:
                self._remaps.append(value)
            elif option in PARAMETER:
                self.parameters.append(_parameter_of_rule(value))
            elif option == FILE:
                self.parameters += _parameters_of_file(value)

    def full_name(self, name: str) -> str:
        """Return a node's full name after the remappings of the command line."""
        namespace = self._remapped('__ns', name) or '/'
        base = self._remapped('__node', name) or self._remapped('__name', name) or name
        return f'{namespace.rstrip("/")}/{base}'

    def _remapped(self, what: str, node: str) -> str:
        """Return the new value of `what` for a node by the first matching rule, '' without one."""
        for rule in self._remaps:
            left, _, value = rule.partition(':=')
            if left in (what, f'{node}:{what}'):
                return value
        return ''


def _split(arguments: Sequence[str]) -> tuple[list[str], list[tuple[str, str]]]:
    """Return the plain arguments, and each ROS argument paired with the argument after it."""
    plain: list[str] = []
    options: list[tuple[str, str]] = []
    is_ros = False
    for argument, following in zip_longest(arguments, arguments[1:], fillvalue=''):
        if argument == '--ros-args':
            is_ros = True
        elif is_ros and argument == '--':
            is_ros = False
        elif is_ros:
            options.append((argument, following))
        else:
            plain.append(argument)
    return plain, options


def _parameter_of_rule(rule: str) -> GivenParameter:
    """Return the parameter that a rule of the form [NODE:]NAME:=VALUE sets.

    Raise UsageError for a value that rcl, the ROS client library, cannot read.
    """
    left, _, value = rule.partition(':=')
    try:
        is_valid = bool(value) and not isinstance(plain_data(value, _Untagged), Mapping)
    except ConfigError:
        is_valid = False
    if not is_valid:
        raise UsageError(
            f'-p {rule} is invalid: write -p NAME:=VALUE, with a value such as 2.5, true, '
            "'[1.0, 2.0]' or text. An empty text, and text with YAML special characters, need two "
            'pairs of quotes: -p NAME:="\'TEXT\'"'
        )
    node, colon, name = left.rpartition(':')
    return GivenParameter(f'/{node.lstrip("/")}' if colon else ANY_NODE, name, '-p')


def _parameters_of_file(file: str) -> Iterator[GivenParameter]:
    try:
        content = read_plain(Path(file), _Untagged)
    except OSError as error:
        raise UsageError(f'parameter file {file}: {error.strerror}') from None
    except ConfigError as error:
        raise UsageError(
            f'parameter file {file} is not valid YAML ({error}): correct the file'
        ) from None
    if not isinstance(content, Mapping):
        raise UsageError(f"parameter file {file} has no section 'NODE: {_SECTION}:': add one")
    for node, values in _sections(content, '', file):
        for name in _leaves(values):
            yield GivenParameter(node, name, file)


def _sections(content: Any, node: str, file: str) -> Iterator[tuple[str, Any]]:
    """Yield each node's full name in a parameter file, and its section ros__parameters."""
    if not isinstance(content, Mapping):
        raise UsageError(
            f"'{node.lstrip('/')}' in parameter file {file} is outside of any section "
            f"'NODE: {_SECTION}:': move it into such a section"
        )
    for key, below in content.items():
        if key == _SECTION:
            yield node or '/', below
        else:
            yield from _sections(below, f'{node}/{str(key).strip("/")}', file)


def _leaves(values: Any, prefix: str = '') -> Iterator[str]:
    """Yield the full names of nested parameters, such as `group.name`."""
    for key, value in values.items() if isinstance(values, Mapping) else ():
        if isinstance(value, Mapping):
            yield from _leaves(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'
