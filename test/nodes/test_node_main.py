import pytest
import rclpy
from rclpy.executors import ExternalShutdownException

from aerarm_ros.nodes.node_main import run_node


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


@pytest.mark.parametrize(
    'action',
    [
        lambda: None,
        raising(KeyboardInterrupt()),
        raising(ExternalShutdownException()),
        rclpy.shutdown,
    ],
    ids=['returns', 'SIGINT', 'shutdown', 'context'],
)
def test_ordinary_ends(ros_domain, action) -> None:
    node = Script(action)
    assert run_node('script', lambda: node, []) == 0
    assert node.closed == 1
    assert not rclpy.ok()


def test_the_status_of_the_node_is_the_exit_status(ros_domain) -> None:
    node = Script(lambda: setattr(node, 'status', 3))
    assert run_node('script', lambda: node, []) == 3


@pytest.mark.parametrize('error', [ValueError('gain\n is bad'), OSError('gain is bad')])
def test_what_the_user_can_repair_is_one_line(ros_domain, capsys, error: Exception) -> None:
    assert run_node('script', raising(error), []) == 1
    assert capsys.readouterr().err == 'script: gain is bad\n'
    assert not rclpy.ok()


def test_a_defect_keeps_its_traceback_and_the_node_is_closed(ros_domain) -> None:
    node = Script(raising(ValueError('bug')))
    with pytest.raises(ValueError, match='bug'):
        run_node('script', lambda: node, [])
    assert node.closed == 1
    assert not rclpy.ok()


def test_bad_ros_arguments_are_one_line(ros_domain, capsys) -> None:
    assert run_node('script', lambda: Script(lambda: None), ['--ros-args', '--bad']) == 1
    assert capsys.readouterr().err.startswith('script: ')
