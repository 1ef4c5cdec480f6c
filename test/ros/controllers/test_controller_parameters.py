"""Live parameters of controllers, accepted or rejected at once, and hand guiding."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
import rclpy
from controller_bench import NAMES, trajectory
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.nodes.controllers.computed_torque import ComputedTorqueNode
from aerarm_ros.nodes.controllers.gravity_compensation import GravityCompensationNode
from aerarm_ros.nodes.controllers.impedance_control import ImpedanceControlNode
from aerarm_ros.ros.controllers.controller_node import ControllerNode

CYCLE = 1e-3
UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])
REST = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))


@pytest.fixture
def make(ros_domain: dict[str, str]) -> Iterator[Callable[..., ControllerNode]]:
    nodes = []

    def make(kind: type[ControllerNode], *parameters: str) -> ControllerNode:
        rclpy.init(args=['--ros-args', *(part for p in parameters for part in ('-p', p))])
        nodes.append(kind())
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()
    rclpy.try_shutdown()


def act(node: ControllerNode, now: float = 0.0) -> None:
    """Run the waiting actions of the loop's thread."""
    while node._requests:
        node._requests.popleft()(now)


@pytest.mark.parametrize(
    ('kind', 'parameters', 'name', 'values', 'reason'),
    [
        (ComputedTorqueNode, (), 'kp', [1.0, 2.0], '2 values, 4 are needed'),
        (ComputedTorqueNode, ('feedback:=boards',), 'kd', [30.0], 'gains of the bridge'),
        (GravityCompensationNode, (), 'kd', [1.0] * 5, '5 values, 4 are needed'),
        (ImpedanceControlNode, (), 'stiffness', [1.0] * 4, '4 values, 3 are needed'),
    ],
)
def test_gains_that_do_not_fit_are_refused(make, kind, parameters, name, values, reason) -> None:
    node = make(kind, *parameters)
    before = node.node.get_parameter(name).value
    answer = node.node.set_parameters([Parameter(name, value=values)])[0]
    assert not answer.successful
    assert reason in answer.reason
    assert node.node.get_parameter(name).value == before


def test_gains_that_fit_are_taken(make) -> None:
    node = make(ComputedTorqueNode)
    assert node.node.set_parameters([Parameter('kp', value=[100.0])])[0].successful
    act(node)
    np.testing.assert_array_equal(node.law.kp, np.full(4, 100.0))


def play(node: GravityCompensationNode, state: ArmState, start: float, cycles: int) -> np.ndarray:
    """Answer the same state for some cycles; return the efforts (cycles, n) [Nm]."""
    efforts = []
    for cycle in range(cycles):
        now = start + cycle * CYCLE
        act(node, now)
        node.before_update(state, now)
        command = node.loop.update(state, now)
        efforts.append(np.full(4, np.nan) if command is None else command.tau)
    return np.array(efforts)


def guide(node: GravityCompensationNode, is_on: bool) -> None:
    assert node.node.set_parameters([Parameter('hand_guiding', value=is_on)])[0].successful


def test_hand_guiding_comes_and_goes_without_a_step(make) -> None:
    node = make(GravityCompensationNode, 'observer_gain:=0.0')
    play(node, REST, 0.0, 10)
    pushed = REST._replace(q=UPRIGHT + 0.05)
    efforts = [play(node, pushed, 0.01, 10)]
    guide(node, True)
    efforts.append(play(node, pushed, 0.02, 1000))
    guide(node, False)
    efforts.append(play(node, pushed, 1.02, 1000))
    effort = np.vstack(efforts)
    assert np.abs(effort[0] - effort[-1]).max() > 1.0
    assert np.abs(np.diff(effort, axis=0)).max() < 0.02
    # It holds where it was let go.
    np.testing.assert_allclose(node.follower.reference.q, pushed.q)


def test_references_are_rejected_during_hand_guiding(make, monkeypatch) -> None:
    acts = {}
    monkeypatch.setattr(
        ControllerNode, 'listen', lambda self, topic, act: acts.update({topic.name: act})
    )
    node = make(GravityCompensationNode, 'hand_guiding:=true')
    node._mode = 'running'
    for name, message in (
        ('set_point', JointState(name=NAMES)),
        ('joint_trajectory', trajectory(list(UPRIGHT), 1.0)),
    ):
        with pytest.raises(RejectedInputError, match='hand_guiding'):
            acts[name](message, 0.0)
    assert node.ahead(np.zeros(1)) is None
