import os

import pytest

from aerarm_ros.ros.process.node_process import is_on_this_host, stay_on_this_host

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


@pytest.mark.parametrize(
    ('environment', 'alone'),
    [
        ({RANGE: 'LOCALHOST'}, True),
        ({'ROS_LOCALHOST_ONLY': '1'}, True),
        ({}, False),
        ({RANGE: 'SUBNET'}, False),
        ({RANGE: 'OFF'}, False),
        ({'ROS_LOCALHOST_ONLY': '0'}, False),
        # Who names a peer wants to be reached from there.
        ({RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': '192.168.1.2'}, False),
        ({RANGE: 'LOCALHOST', 'ROS_DISCOVERY_SERVER': '192.168.1.2:11811'}, False),
    ],
)
def test_who_is_alone_on_this_host(environment: dict[str, str], alone: bool) -> None:
    assert is_on_this_host(environment) is alone
