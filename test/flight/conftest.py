"""Flights of a drone with its arm."""

import pytest
from flown_arm import Flight


@pytest.fixture
def fly() -> type[Flight]:
    return Flight
