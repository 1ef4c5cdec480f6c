"""Write docs/reference/parameters.md from the parameter tables of the nodes.

Usage: python docs/generate_parameters.py
"""

from __future__ import annotations

import contextlib
import importlib
import io
import re
from pathlib import Path
from unittest.mock import patch

from aerarm_ros.executables import command_modules
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'reference' / 'parameters.md'
INTRODUCTION = """# Parameters

`docs/generate_parameters.py` writes this page from the parameter tables of the nodes.
`ros2 param describe` prints the description of a parameter of a running node. A node rejects a
value outside its bounds and prints the allowed values.

- You can change *live* parameters while the node runs: `ros2 param set /NODE NAME VALUE`.
- A node reads all other parameters at its start:
  `ros2 run aerarm_ros NODE --ros-args -p NAME:=VALUE` or `--params-file FILE`.
- `ros2 param dump NODE` prints a parameter file of a running node.

The section [shared](#shared) contains the parameters that several nodes have in common.
"""
HEAD = '| name | type | default | allowed | description |\n|---|---|---|---|---|\n'

# Title of each shared group, by the name of its first parameter.
TITLES = {
    'config': 'Configuration and prefix of the arm',
    'urdf': 'URDF of the arm',
    'drone_file': 'Drone',
    'realtime_priority': 'Real time',
    'bridges': 'Bridges to call',
    'base_motion': 'Motion of the base',
    'payload.inertial_parameters': 'Payload, rotors and friction of the model',
    'at_end': 'End of the node',
    'friction_file': 'Friction, disturbance observer and payload compensation',
    'rotor_share': 'Rotor thrust that motions may use',
    'heading_max': 'Heading of the drone during motions',
    'compensation': 'Limit of the disturbance observer',
    'feed_lead': 'Preview time of the feed-forward',
    'excitation_config': 'Collision checks',
    'frame': 'Cartesian targets',
    'friction_fraction': 'Trajectories and goals',
    'tracking_limit': 'Checks while a motion plays',
    'firmware': 'Firmware of the autopilot',
    'period': 'Bridge',
    'rate': 'Set points for the autopilot',
}


class TableFoundError(Exception):
    """Interrupts a node when it declares its parameters, and carries them."""

    def __init__(self, parameters: list[Parameter]) -> None:
        super().__init__('found')
        self.parameters = parameters


def parameters_of(executable: str) -> list[Parameter]:
    """Return the parameters of an executable, an empty list if it is not a node with a table.

    The function starts the node and interrupts it when it declares its parameters, so that the
    list is complete. A node that exits earlier, because a message package is missing, has its
    table PARAMETERS at the top of the module.
    """
    name = command_modules()[executable]
    source = (ROOT / f'{name.replace(".", "/")}.py').read_text()
    if not re.search(r'run_node\(|^PARAMETERS = ', source, re.MULTILINE):
        return []

    def find(table: ParameterTable, *_: object) -> None:
        raise TableFoundError(list(table._parameters.values()))

    module = importlib.import_module(name)
    with patch.object(ParameterTable, 'declare', find), contextlib.redirect_stderr(io.StringIO()):
        try:
            module.main([])
        except TableFoundError as found:
            return found.parameters
        except SystemExit:  # the command line lacks required arguments
            return []
    if isinstance(getattr(module, 'PARAMETERS', None), ParameterTable):
        return list(module.PARAMETERS._parameters.values())
    raise ValueError(f'{executable} ended without declaring its parameters')


def page() -> str:
    """Return the whole page."""
    tables = {name: parameters_of(name) for name in command_modules()}
    nodes_of: dict[str, list[str]] = {}
    for name, parameters in tables.items():
        for parameter in parameters:
            nodes_of.setdefault(_row(parameter), []).append(name)
    groups: dict[tuple[str, ...], list[str]] = {}
    for row, nodes in nodes_of.items():
        groups.setdefault(tuple(nodes), []).append(row)
    shared = {nodes: rows for nodes, rows in groups.items() if len(nodes) > 1}
    titles = {nodes: _title(nodes, rows) for nodes, rows in shared.items()}
    if len(set(titles.values())) < len(titles):
        raise ValueError(f'two shared groups have one title, see TITLES: {sorted(titles.values())}')
    parts = [INTRODUCTION, '## Shared\n']
    for nodes, rows in sorted(shared.items(), key=lambda item: -len(item[0])):
        used = ', '.join(f'[{name}](#{name})' for name in nodes)
        parts.append(f'### {titles[nodes]}\n\nNodes: {used}.\n\n{HEAD}{"".join(rows)}')
    for name, parameters in tables.items():
        if parameters:
            of_node = [titles[nodes] for nodes in shared if name in nodes]
            parts.append(_section(name, of_node, groups.get((name,), [])))
    return '\n'.join(parts)


def _title(nodes: tuple[str, ...], rows: list[str]) -> str:
    first = rows[0].split('`')[1]
    return TITLES.get(first, f'Parameters {first} of {len(nodes)} nodes from {nodes[0]}')


def _section(executable: str, shared: list[str], rows: list[str]) -> str:
    links = '; '.join(f'[{title}](#{_anchor(title)})' for title in shared)
    text = f'## {executable}\n'
    if shared:
        text += f'\nShared parameters: {links}.\n'
    return text + (f'\n{HEAD}{"".join(rows)}' if rows else '')


def _anchor(title: str) -> str:
    return title.lower().replace(',', '').replace(' ', '-')


def _row(parameter: Parameter) -> str:
    kind = parameter.kind.replace('_array', '[]')
    default = _default(parameter.default)
    cells = (
        f'`{parameter.name}`',
        f'{kind}, live' if parameter.live else kind,
        f'{default} {parameter.unit}'.strip() if default else parameter.unit,
        _allowed(parameter),
        parameter.description.replace('|', '\\|'),
    )
    return f'| {" | ".join(cells)} |\n'


def _default(value: object) -> str:
    if value == '':
        return ''
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    if isinstance(value, (list, tuple)):
        return f'`[{", ".join(map(str, value))}]`'
    return f'`{value}`'


def _allowed(parameter: Parameter) -> str:
    if parameter.choices:
        return ', '.join(f'`{choice}`' for choice in parameter.choices)
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return ''
    if high is None:
        return f'at least {low:g}'
    return f'at most {high:g}' if low is None else f'{low:g} to {high:g}'


if __name__ == '__main__':
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page())
    print(PAGE)
