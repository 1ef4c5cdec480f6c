"""What a node waits for, with what to do when it is ready, for an executor of our own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from rclpy.client import Client
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable


class WaitedEntity:
    """A timer, subscription, guard condition, client or service.

    Parameters
    ----------
    kind
        Name of its kind in rclpy's wait sets.
    handle
        Its handle, a context that keeps it from being destroyed.
    run
        Takes what has come and calls the callback.

    Attributes
    ----------
    count
        Room that it takes in a wait set.
    """

    def __init__(self, kind: str, handle: Any, run: Callable[[], None]) -> None:
        self.handle = handle
        self.run = run
        self.count = NumberOfEntities()
        setattr(self.count, f'num_{kind}s', 1)
        self._kind = kind
        self._add = f'add_{kind}'
        self._index = 0

    def add_to(self, wait_set: Any) -> None:
        """Enter it into a wait set that was cleared."""
        self._index = getattr(wait_set, self._add)(self.handle)

    def is_ready(self, wait_set: Any) -> bool:
        """Whether the wait that has ended found it ready."""
        return bool(wait_set.is_ready(self._kind, self._index))


class WaitedWaitable:
    """A waitable of rclpy, such as the events of a publisher; used like a `WaitedEntity`."""

    def __init__(self, waitable: Waitable) -> None:
        self.handle = waitable
        self.count = waitable.get_num_entities()
        self.add_to = waitable.add_to_wait_set
        self.is_ready = waitable.is_ready

    def run(self) -> None:
        """Take what has come and call the callback, which may not wait."""
        coroutine = self.handle.execute(self.handle.take_data())
        try:
            coroutine.send(None)
        except StopIteration:
            return
        coroutine.close()
        raise RuntimeError(f'a callback of {self.handle} waits: this executor does not go on')


def waited_entities(node: Node) -> Iterator[WaitedEntity | WaitedWaitable]:
    """Yield what a node waits for, without what its callback group lets nobody run."""
    for kind, entities, run in (
        ('timer', node.timers, _run_timer),
        ('subscription', node.subscriptions, _run_subscription),
        ('guard_condition', node.guards, _run_guard),
        ('client', node.clients, _run_client),
        ('service', node.services, _run_service),
    ):
        for entity in entities:
            if entity.callback_group.can_execute(entity):
                yield WaitedEntity(kind, entity.handle, partial(run, entity))
    for waitable in node.waitables:
        if waitable.callback_group.can_execute(waitable):
            yield WaitedWaitable(waitable)


def _run_timer(timer: Timer) -> None:
    if timer.handle.is_timer_ready():
        timer.handle.call_timer()
        timer.callback()


def _run_subscription(subscription: Subscription) -> None:
    message = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    if message is not None:
        with_info = subscription._callback_type is Subscription.CallbackType.WithMessageInfo
        subscription.callback(*message[: 2 if with_info else 1])


def _run_guard(guard: GuardCondition) -> None:
    guard.callback()


def _run_client(client: Client) -> None:
    header, response = client.handle.take_response(client.srv_type.Response)
    if header is None:
        return
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:
        return  # nobody waits for it any more
    future.set_result(response)


def _run_service(service: Service) -> None:
    request, header = service.handle.service_take_request(service.srv_type.Request)
    if header is not None:
        service.send_response(service.callback(request, service.srv_type.Response()), header)
