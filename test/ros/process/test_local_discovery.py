import pytest

from aerarm_ros.ros.executors import this_domain
from aerarm_ros.ros.process.node_process import is_on_this_host, stay_on_this_host

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@pytest.mark.parametrize(
    'given',
    [
        {},
        {RANGE: 'SUBNET'},
        {'ROS_STATIC_PEERS': '192.168.1.2'},
        {RANGE: 'LOCALHOST', 'ROS_DISCOVERY_SERVER': '192.168.1.2:11811'},
        {'ROS_LOCALHOST_ONLY': '0'},
        {RANGE: 'SYSTEM_DEFAULT', 'ROS_STATIC_PEERS': '192.168.1.2'},
    ],
    ids=str,
)
def test_discovery_is_restricted_to_this_host_in_any_environment(given: dict[str, str]) -> None:
    environment = dict(given)
    notice = stay_on_this_host(environment)
    assert environment == {RANGE: 'LOCALHOST'}
    assert is_on_this_host(environment)
    assert all(name in notice for name in given if given[name] != 'LOCALHOST')
    assert bool(notice) == bool(given)


@pytest.mark.parametrize('given', [{RANGE: 'LOCALHOST'}, {RANGE: 'OFF'}], ids=str)
def test_a_range_within_this_host_stays_without_a_notice(given: dict[str, str]) -> None:
    environment = dict(given)
    assert stay_on_this_host(environment) == ''
    assert environment == given


@pytest.mark.parametrize(
    ('name', 'value'), [(RANGE, 'SUBNET'), (RANGE, 'OFF'), ('ROS_STATIC_PEERS', '192.168.1.2')]
)
def test_an_open_network_leaves_the_environment_as_it_is(name: str, value: str) -> None:
    environment = {'AERARM_NETWORK': 'open', name: value}
    assert stay_on_this_host(environment) == ''
    assert environment == {'AERARM_NETWORK': 'open', name: value}


def test_another_value_of_the_variable_is_an_error() -> None:
    with pytest.raises(
        ValueError, match=r"AERARM_NETWORK='yes' is invalid: .* AERARM_NETWORK=open"
    ):
        stay_on_this_host({'AERARM_NETWORK': 'yes'})


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
def test_environments_restricted_to_this_host_are_recognized(
    environment: dict[str, str], alone: bool
) -> None:
    assert is_on_this_host(environment) is alone


@pytest.mark.parametrize(
    ('network', 'where'),
    [
        ('', 'on this host only; ground_link connects hosts'),
        # For example with ROS_STATIC_PEERS on the ground alone.
        ('open', 'with all hosts on which AERARM_NETWORK=open is set'),
    ],
)
def test_messages_about_missing_nodes_say_which_hosts_were_searched(
    network: str, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.setenv('AERARM_NETWORK', network)
    assert this_domain() == f'this ROS domain (ROS_DOMAIN_ID=7, {where})'
