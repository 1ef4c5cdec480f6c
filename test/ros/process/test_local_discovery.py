import os

import pytest

from aerarm_ros.ros.process.local_discovery import stay_on_this_host

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment that says nothing about discovery, put back at the end."""
    for name in (RANGE, 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY', 'ROS_DISCOVERY_SERVER'):
        monkeypatch.setenv(name, '')
    return monkeypatch


def test_nodes_are_found_on_this_host_only(silent: pytest.MonkeyPatch) -> None:
    stay_on_this_host()
    assert os.environ[RANGE] == 'LOCALHOST'


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        (RANGE, 'SUBNET'),
        (RANGE, 'OFF'),
        ('ROS_STATIC_PEERS', '192.168.1.2'),
        ('ROS_DISCOVERY_SERVER', '192.168.1.2:11811'),
    ],
)
def test_who_has_decided_is_left_alone(silent: pytest.MonkeyPatch, name: str, value: str) -> None:
    silent.setenv(name, value)
    before = dict(os.environ)
    stay_on_this_host()
    assert dict(os.environ) == before
