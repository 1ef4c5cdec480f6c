"""Every numeric parameter of a node is bounded on both sides."""

import importlib
from importlib.metadata import entry_points

from aerarm_ros.executables import command_modules

NUMERIC = {'integer', 'double', 'integer_array', 'double_array'}
# They have options instead of parameters.
PROGRAMS = {'arm', 'calibrator', 'demo', 'excitation_designer', 'experiment', 'identifier'}


def nodes() -> list[str]:
    """Return the executables that have parameters."""
    scripts = entry_points(group='console_scripts')
    names = {s.name for s in scripts if s.value.startswith('aerarm_ros.executables:')}
    return sorted(names - PROGRAMS)


def test_every_number_has_both_bounds() -> None:
    for name in nodes():
        for parameter in importlib.import_module(command_modules()[name]).PARAMETERS:
            if parameter.kind in NUMERIC and not parameter.choices:
                bounds = parameter.minimum, parameter.maximum
                assert None not in bounds, f'{name}.{parameter.name}'
