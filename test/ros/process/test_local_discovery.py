"""Environment variables for ROS: which hosts are searched, and where logs are written."""

import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.ros.executors import this_domain
from aerarm_ros.ros.process.node_process import (
    find_log_directory,
    is_on_this_host,
    stay_on_this_host,
)

RANGE, SERVER = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_DISCOVERY_SERVER'
PEER = {'ROS_STATIC_PEERS': '192.168.1.2'}
HERE = {RANGE: 'LOCALHOST'}


@pytest.mark.parametrize(
    'given',
    [
        {},
        {RANGE: 'SUBNET'},
        PEER,
        {**HERE, SERVER: '192.168.1.2:11811'},
        {'ROS_LOCALHOST_ONLY': '0'},
        {RANGE: 'SYSTEM_DEFAULT', **PEER},
    ],
    ids=str,
)
def test_discovery_is_restricted_to_this_host_in_any_environment(given: dict[str, str]) -> None:
    environment = dict(given)
    notice = stay_on_this_host(environment)
    assert environment == HERE
    assert all(name in notice for name in given if given[name] != 'LOCALHOST')
    assert bool(notice) == bool(given)


@pytest.mark.parametrize(
    'given',
    [
        HERE,
        {RANGE: 'OFF'},
        {'AERARM_NETWORK': 'open', RANGE: 'SUBNET'},
        {'AERARM_NETWORK': 'open', RANGE: 'OFF'},
        {'AERARM_NETWORK': 'open', **PEER},
    ],
    ids=str,
)
def test_an_open_network_or_a_range_within_this_host_stays(given: dict[str, str]) -> None:
    environment = dict(given)
    assert stay_on_this_host(environment) == ''
    assert environment == given


def test_another_value_of_the_variable_is_an_error() -> None:
    problem = r"AERARM_NETWORK='yes' is invalid: .* AERARM_NETWORK=open"
    with pytest.raises(ValueError, match=problem):
        stay_on_this_host({'AERARM_NETWORK': 'yes'})


@pytest.mark.parametrize(
    ('environment', 'alone'),
    [
        (HERE, True),
        ({'ROS_LOCALHOST_ONLY': '1'}, True),
        ({}, False),
        ({RANGE: 'SUBNET'}, False),
        ({RANGE: 'OFF'}, False),
        ({'ROS_LOCALHOST_ONLY': '0'}, False),
        # Who names a peer wants to be reached from there.
        ({**HERE, **PEER}, False),
        ({**HERE, SERVER: '192.168.1.2:11811'}, False),
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


def test_logs_go_to_the_chosen_directory_the_home_or_a_temporary_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def found(environment: dict[str, str]) -> dict[str, str]:
        find_log_directory(environment)
        return environment

    for name in ('ROS_LOG_DIR', 'ROS_HOME', 'HOME'):
        assert found({name: '/somewhere'}) == {name: '/somewhere'}
    assert found({}) == {'HOME': pwd.getpwuid(os.getuid()).pw_dir}

    def unknown(_: int) -> None:
        raise KeyError

    monkeypatch.setattr('aerarm_ros.ros.process.node_process.getpwuid', unknown)
    environment = found({})
    directory = Path(environment.pop('ROS_LOG_DIR'))
    assert (environment, list(directory.iterdir())) == ({}, [])
    directory.rmdir()


def test_a_node_starts_in_an_empty_environment(ros_domain: dict[str, str]) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'arm', 'enable', '--timeout', '0.5']
    run = subprocess.run(command, env=ros_domain, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert 'check that a bridge runs' in run.stderr
    assert 'Traceback' not in run.stderr
