"""The managed node: configure, activate, deactivate, cleanup, shutdown by a lifecycle client."""

from bridge_client import BridgeClient, StartBridge, velocity_command
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from quick_spinning import spin_until
from rclpy.node import Node


class Lifecycle:
    """Client with the requests of a launch file or of `ros2 lifecycle`."""

    def __init__(self, node: Node, name: str = 'fake_hardware') -> None:
        self._node = node
        self._change = node.create_client(ChangeState, f'{name}/change_state')
        self._state = node.create_client(GetState, f'{name}/get_state')
        assert self._change.wait_for_service(60.0)
        assert self._state.wait_for_service(60.0)
        # An answer to a client that the node has not discovered yet is lost: ask until one
        # comes. Clients are discovered in the order in which they were made.
        answers = 0
        while not answers:
            future = self._state.call_async(GetState.Request())
            spin_until(node, future.done, 1.0)
            answers += future.done()

    def trigger(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return self._call(self._change, request).success

    @property
    def state(self) -> int:
        return self._call(self._state, GetState.Request()).current_state.id

    def _call(self, client, request):
        future = client.call_async(request)
        assert spin_until(self._node, future.done, 60.0)
        return future.result()


def test_all_transitions(start_bridge: StartBridge, ros_node: Node) -> None:
    process = start_bridge(autostart=False)
    client, lifecycle = BridgeClient(ros_node), Lifecycle(ros_node)
    assert lifecycle.state == State.PRIMARY_STATE_UNCONFIGURED
    answer = client.call('enable')
    assert not answer.success
    assert 'activate it first' in answer.message
    # Invalid transitions are refused and change nothing.
    for transition in (
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_ACTIVE_SHUTDOWN,
        250,
    ):
        assert not lifecycle.trigger(transition)
        assert lifecycle.state == State.PRIMARY_STATE_UNCONFIGURED
    assert 'in state unconfigured: choose one of configure, shutdown' in process.tail()

    assert lifecycle.trigger(Transition.TRANSITION_CONFIGURE)
    assert not lifecycle.trigger(Transition.TRANSITION_CONFIGURE)
    assert lifecycle.state == State.PRIMARY_STATE_INACTIVE
    assert not client.states
    assert lifecycle.trigger(Transition.TRANSITION_ACTIVATE)
    assert not lifecycle.trigger(Transition.TRANSITION_CLEANUP)
    assert lifecycle.state == State.PRIMARY_STATE_ACTIVE
    client.make_ready()
    client.answer = lambda state: velocity_command(state, [0.3, 0.0, 0.0, 0.0])
    client.wait_for_mode('running')

    # Deactivating switches the motors off; activating does not switch them on again.
    assert lifecycle.trigger(Transition.TRANSITION_DEACTIVATE)
    client.answer = None
    client.wait_for_mode('inactive')
    client.wait_for(lambda: client.messages['arm'] == 'not active')
    assert not client.call('enable').success
    assert lifecycle.trigger(Transition.TRANSITION_ACTIVATE)
    client.wait_for_mode('idle')
    client.modes.clear()
    assert client.call('enable').success
    client.wait_for_mode('ready')
    assert 'aligning' in client.modes

    assert lifecycle.trigger(Transition.TRANSITION_DEACTIVATE)
    assert lifecycle.trigger(Transition.TRANSITION_CLEANUP)
    assert lifecycle.state == State.PRIMARY_STATE_UNCONFIGURED
    assert lifecycle.trigger(Transition.TRANSITION_CONFIGURE)
    assert lifecycle.trigger(Transition.TRANSITION_ACTIVATE)
    client.wait_for_mode('idle')
    assert lifecycle.trigger(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert process.wait(60.0) == 0
    assert 'Traceback' not in process.tail(100)


def test_a_failed_configuration_is_reported_and_the_next_ones_leave_one_drone(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    process = start_bridge(autostart=False, base_motion_profile='moving', board_kp=[9.0])
    lifecycle = Lifecycle(ros_node)
    assert not lifecycle.trigger(Transition.TRANSITION_CONFIGURE)
    assert lifecycle.state == State.PRIMARY_STATE_UNCONFIGURED
    assert 'not configured' in process.tail()
    assert 'carry 0 to 5.09' in process.tail()
    assert BridgeClient(ros_node).set_parameters(board_kp=[]) == []
    for _ in range(2):
        assert lifecycle.trigger(Transition.TRANSITION_CONFIGURE)
        assert spin_until(ros_node, lambda: ros_node.count_publishers('imu') > 0, 60.0)
        assert ros_node.count_publishers('imu') == 1
        assert lifecycle.trigger(Transition.TRANSITION_CLEANUP)
        assert spin_until(ros_node, lambda: ros_node.count_publishers('imu') == 0, 60.0)
