import subprocess
import sys

import pytest
import rclpy
from rclpy.executors import ExternalShutdownException

from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node


class Script:
    """A node that does what it is told and remembers whether it was closed."""

    def __init__(self, action) -> None:
        self.status = 0
        self.closed = 0
        self._action = action

    def run(self) -> None:
        self._action()

    def close(self) -> None:
        assert rclpy.ok() or self._action is rclpy.shutdown
        self.closed += 1


def raising(error: BaseException):
    def action() -> None:
        raise error

    return action


INTERRUPTED = 'script: interrupted before the task was complete\n'


@pytest.mark.parametrize(
    ('action', 'has_task', 'status', 'said'),
    [
        (lambda: None, False, 0, ''),
        (raising(KeyboardInterrupt()), False, 0, ''),
        (raising(KeyboardInterrupt()), True, 130, INTERRUPTED),
        (raising(ExternalShutdownException()), False, 0, ''),
        (rclpy.shutdown, False, 0, ''),
        (raising(OSError('gain is bad')), False, 1, 'script: gain is bad\n'),
    ],
    ids=['returns', 'SIGINT', 'SIGINT of a task', 'shutdown', 'context', 'OSError'],
)
def test_ends_of_a_node(ros_domain, capsys, action, has_task, status, said) -> None:
    node = Script(action)
    node.status = int(has_task)
    assert run_node('script', lambda: node, []) == status
    assert capsys.readouterr().err == said
    assert node.closed == 1
    assert not rclpy.ok()


@pytest.mark.parametrize('error', [ValueError('gain\n is bad'), OSError('gain is bad')])
def test_user_errors_print_one_line(ros_domain, capsys, error: Exception) -> None:
    assert run_node('script', raising(error), []) == 1
    assert capsys.readouterr().err == 'script: gain is bad\n'
    assert not rclpy.ok()


def test_a_defect_keeps_its_traceback_and_the_node_is_closed(ros_domain) -> None:
    node = Script(raising(ValueError('bug')))
    with pytest.raises(ValueError, match='bug'):
        run_node('script', lambda: node, [])
    assert node.closed == 1
    assert not rclpy.ok()


PARAMETERS = ParameterTable(Parameter('periods', 2, 'how often'))


def test_help_starts_nothing(capsys) -> None:
    assert run_node('script', pytest.fail, ['--help'], PARAMETERS, 'Does it.') == 0
    assert 'Does it.' in capsys.readouterr().out


def test_help_may_be_cut_off(ros_domain) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'fake_hardware', '--help']
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as node:
        node.stdout.close()  # as head does, only sooner
        assert node.stderr.read() == ''
        assert node.wait(60.0) == 0


@pytest.mark.parametrize(
    'line', ['--periods', '--ros-args -p perods:=3', '--ros-args --params-file /nowhere']
)
def test_a_wrong_command_line_is_one_line_and_starts_nothing(capsys, line: str) -> None:
    assert run_node('script', pytest.fail, line.split(), PARAMETERS) == 2
    error = capsys.readouterr().err
    assert (error[:8], error.count('\n')) == ('script: ', 1)


def test_bad_ros_arguments_are_one_line(ros_domain, capsys) -> None:
    assert run_node('script', lambda: Script(lambda: None), ['--ros-args', '--bad']) == 2
    assert capsys.readouterr().err.startswith('script: ')


def test_a_file_for_several_nodes_is_used_as_rclpy_understands_it(
    ros_domain, capsys, tmp_path
) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(
        '/**: {ros__parameters: {use_sim_time: false, speed: 1.0, perods: 7}}\n'
        '/**/script: {ros__parameters: {periods: 3}}\n'
        'other: {ros__parameters: {perods: 4}}\n'
    )
    found = []

    def create() -> Script:
        node = rclpy.create_node('script')
        found.append(PARAMETERS.declare(node).periods)
        node.destroy_node()
        return Script(lambda: None)

    arguments = ['--ros-args', '-r', '__ns:=/left', '--params-file', str(file)]
    assert run_node('script', create, arguments, PARAMETERS) == 0
    assert found == [3]
    error = capsys.readouterr().err
    assert error.startswith(f"script: warning: unknown parameter 'perods' in {file}, did you")
    assert error.count('\n') == 1
