"""Answers for lifecycle clients that ask for what is not possible now."""

from __future__ import annotations

from lifecycle_msgs.srv import ChangeState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode


def answer_invalid_transitions(node: LifecycleNode) -> None:
    """Let a node refuse transitions that its state doesn't have, and log which it has.

    rclpy (7.1) raises instead, so the client never gets an answer.
    """
    service = node._service_change_state
    change = service.callback

    def handle(request: ChangeState.Request, response: ChangeState.Response) -> object:
        try:
            return change(request, response)
        except RCLError:
            machine = node._state_machine
            _, state = machine.current_state
            labels = [label for _, label, *_ in machine.available_transitions]
            wanted = request.transition.label or f'number {request.transition.id}'
            node.get_logger().warning(
                f'no transition {wanted} from {state}: possible are {", ".join(labels)}'
            )
            response.success = False
            return response

    service.callback = handle
