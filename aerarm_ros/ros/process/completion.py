"""What a shell completes: scripts for bash, and for zsh with bashcompinit."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from aerarm_ros.ros.process.ros_arguments import COMPLETION

if TYPE_CHECKING:  # tools without ROS complete their options, too
    from aerarm_ros.ros.parameters.parameter_table import Parameter

# Said once in a script, also where zsh reads it.
_ZSH = '[ -n "$ZSH_VERSION" ] && autoload -U +X bashcompinit && bashcompinit'


def script(
    name: str,
    words: Sequence[str],
    after: Mapping[str, Sequence[str]] | None = None,
    commands: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """Return a script that completes the command line of an executable.

    Parameters
    ----------
    name
        Of the executable.
    words
        What may stand anywhere; file names are offered where none of them fits.
    after
        What may stand behind a word, such as the choices of an option.
    commands
        What may stand behind a command, which is the first word.
    """
    return f"""_{name}() {{
  local words="{' '.join(words)}"
  [ "$COMP_CWORD" -gt 1 ] && case "${{COMP_WORDS[1]}}" in
{_cases(commands or {})}
  esac
  case "${{COMP_WORDS[COMP_CWORD-1]}}" in
{_cases(after or {})}
  esac
  COMPREPLY=($(compgen -o default -W "$words" -- "${{COMP_WORDS[COMP_CWORD]}}"))
  [[ "${{COMPREPLY[*]}}" == *:= ]] && compopt -o nospace
  return 0
}}
{_ZSH}
complete -o default -F _{name} {name}"""


def parser_script(parser: argparse.ArgumentParser) -> str:
    """Return the script of a program with options, and with commands if it has any."""
    commands: dict[str, argparse.ArgumentParser] = {}
    for action in parser._actions:
        if isinstance(action.choices, dict):
            commands |= action.choices
    after = {
        option: [str(choice) for choice in action.choices]
        for one in (parser, *commands.values())
        for action in one._actions
        if action.choices and not isinstance(action.choices, dict)
        for option in action.option_strings
    }
    of_commands = {name: _options(command) for name, command in commands.items()}
    return script(parser.prog, list(commands) or _options(parser), after, of_commands)


def node_script(name: str, parameters: Sequence[Parameter]) -> str:
    """Return the script of a node: its parameters, and the options that ROS has for them."""
    given = [f'{parameter.name}:=' for parameter in parameters]
    options = ['--help', '--ros-args', '-p', '--params-file', '-r']
    return script(name, options, dict.fromkeys(('-p', '--param'), given))


def lazy_script(names: Sequence[str]) -> str:
    """Return a script that asks an executable for its own when it is first completed."""
    return f"""_aerarm_lazy() {{
  local name="${{1##*/}}"
  eval "$("$1" {COMPLETION} 2>/dev/null)"
  if declare -F "_$name" >/dev/null; then "_$name" "$@"; fi
}}
{_ZSH}
complete -o default -F _aerarm_lazy {' '.join(names)}"""


def _options(parser: argparse.ArgumentParser) -> list[str]:
    options = (
        option
        for action in parser._actions
        if action.help != argparse.SUPPRESS
        for option in action.option_strings
        if option.startswith('--')
    )
    return sorted(options)


def _cases(words: Mapping[str, Sequence[str]]) -> str:
    lines = [f'    {key}) words="{" ".join(found)}" ;;' for key, found in words.items()]
    return '\n'.join(lines) or '    -) ;;'
