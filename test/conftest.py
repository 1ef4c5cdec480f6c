"""Fixtures used by the tests of several rooms."""

import csv
from collections.abc import Callable
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# The same examples each time, and no limit on their time: other work may share the machine.
settings.register_profile('suite', deadline=None, derandomize=True)
settings.load_profile('suite')


@pytest.fixture(scope='session')
def table_a1() -> dict[str, np.ndarray]:
    """Thesis table A.1: the 48 parameters of each of its columns, by the column's name."""
    with (Path(__file__).parent / 'data' / 'table_a1.csv').open() as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in ('CAD', 'SLSQP', 'SA')}


@pytest.fixture(scope='session')
def example_urdf() -> Callable[[str], Path]:
    """Return a function that finds a URDF of the package example-robot-data by file name."""

    def find(name: str) -> Path:
        for file in files('example-robot-data') or ():
            if file.name == name and file.parent.name == 'urdf':
                return Path(str(file.locate()))
        raise FileNotFoundError(f'example-robot-data has no {name}')

    return find
