"""Fixtures of the executables' tests."""

from collections.abc import Callable
from pathlib import Path

import pytest
from bridge_fixtures import bridge, client, start_bridge
from identifier_process import write_bags

from aerarm_ros.description.robot import Robot

__all__ = ['bridge', 'client', 'start_bridge']


@pytest.fixture(scope='session')
def bags(made_once: Callable[[str, Callable[[Path], None]], Path], robot: Robot) -> Path:
    """Return a folder with an identification and a validation bag, for reading only."""
    return made_once('identifier_bags', lambda folder: write_bags(folder, robot))
