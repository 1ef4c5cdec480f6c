"""Every numeric parameter of a node is bounded on both sides."""

import importlib
from importlib.metadata import entry_points

import pytest

from aerarm_ros.executables import command_modules

NUMERIC = {'integer', 'double', 'integer_array', 'double_array'}
# They have options instead of parameters.
PROGRAMS = {'arm', 'calibrator', 'demo', 'excitation_designer', 'experiment', 'identifier'}
# NODE.PARAMETER of those for which any number is right, and why.
UNBOUNDED: dict[str, str] = {}


def nodes() -> list[str]:
    """Return the executables that have parameters."""
    scripts = entry_points(group='console_scripts')
    names = {s.name for s in scripts if s.value.startswith('aerarm_ros.executables:')}
    return sorted(names - PROGRAMS)


@pytest.mark.parametrize('name', nodes())
def test_every_number_has_both_bounds(name: str) -> None:
    table = importlib.import_module(command_modules()[name]).PARAMETERS
    for parameter in table:
        if parameter.kind in NUMERIC and not parameter.choices:
            bounded = parameter.minimum is not None and parameter.maximum is not None
            assert bounded or f'{name}.{parameter.name}' in UNBOUNDED, parameter.name
