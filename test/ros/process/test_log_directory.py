import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.ros.process.node_process import find_log_directory


@pytest.mark.parametrize('name', ['ROS_LOG_DIR', 'ROS_HOME', 'HOME'])
def test_a_choice_stays(name: str) -> None:
    environment = {name: '/somewhere'}
    find_log_directory(environment)
    assert environment == {name: '/somewhere'}


def test_without_home_variable_the_users_home_is_used() -> None:
    environment: dict[str, str] = {}
    find_log_directory(environment)
    assert environment == {'HOME': pwd.getpwuid(os.getuid()).pw_dir}


def test_a_user_without_a_home_logs_among_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_: int) -> None:
        raise KeyError

    monkeypatch.setattr('aerarm_ros.ros.process.node_process.getpwuid', unknown)
    environment: dict[str, str] = {}
    find_log_directory(environment)
    directory = Path(environment.pop('ROS_LOG_DIR'))
    assert environment == {}
    assert list(directory.iterdir()) == []
    directory.rmdir()


def test_a_node_starts_in_an_empty_environment(ros_domain: dict[str, str]) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'arm', 'enable', '--timeout', '0.5']
    run = subprocess.run(command, env=ros_domain, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert 'check that a bridge runs' in run.stderr
    assert 'Traceback' not in run.stderr
