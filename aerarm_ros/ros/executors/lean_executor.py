"""Runs a node's callbacks at a fraction of what rclpy's executors cost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

from aerarm_ros.ros.executors.waited_entity import WaitedEntity, WaitedWaitable, waited_entities

# What is used of rclpy's implementation module, which is not public.
_CALLS = {
    'WaitSet': ('clear_entities', 'wait', 'is_ready', 'add_guard_condition'),
    'Subscription': ('take_message',),
    'Timer': ('is_timer_ready', 'call_timer'),
    'Client': ('take_response',),
    'Service': ('service_take_request',),
}


class LeanExecutor:
    """Waits for one node's entities with a wait set that lasts until they change.

    rclpy's executors build several wait sets for each callback, which they hand over as a
    task: a request for a parameter costs 0.5 to 1 ms of the interpreter's time, here a third
    of it. Callbacks run one after the other, whatever their group; entities of a group that
    lets nothing run, as those of a RawReader, are left alone. Callbacks must not be
    coroutines; what an action server executes may be one.

    Parameters
    ----------
    node
        Its callbacks run.
    before_work
        Called before each callback, if given; may block until it is a good time.
    """

    def __init__(self, node: Node, before_work: Callable[[], None] | None = None) -> None:
        self._node = node
        self._context = node.context
        self._before_work = before_work
        self._guards = (
            GuardCondition(None, None, context=node.context),
            SignalHandlerGuardCondition(context=node.context),
        )
        self._entities: list[WaitedEntity | WaitedWaitable] = []
        self._ready: deque[WaitedEntity | WaitedWaitable] = deque()
        self._tasks: list[Task] = []
        self._held = ExitStack()
        self._changed = True
        self._context.on_shutdown(self.wake)
        node.executor = self

    @staticmethod
    def available() -> bool:
        """Tell whether this rclpy has the calls used here."""
        return all(
            hasattr(getattr(rclpy_implementation, name, None), call)
            for name, calls in _CALLS.items()
            for call in calls
        )

    # What a node asks of its executor.

    def add_node(self, node: Node) -> None:
        """Take note of a node; there is only the one of the constructor."""

    def remove_node(self, node: Node) -> None:
        """Take note that the node has left."""

    def create_task(self, callback: Callable[..., Any], *args: Any) -> Task:
        """Begin a function or coroutine after the present callback; to be called from one.

        A coroutine goes on after each wait, so that what it waits for should come from a callback.
        """
        task = Task(callback, args, executor=None)
        self._tasks.append(task)
        return task

    def wake(self) -> None:
        """End a wait, because entities have changed or something else has."""
        self._changed = True
        with suppress(InvalidHandle):  # after `shutdown`
            self._guards[0].trigger()

    # What its owner does.

    def spin_once(self, timeout_sec: float) -> None:
        """Wait up to a time [s] for something to do, and do it.

        Raises ExternalShutdownException if the context has gone, and what callbacks raise; what
        else was ready then is done by the next call.
        """
        # A guard condition is ready only once, so it must not be forgotten.
        if not self._ready:
            self._wait(timeout_sec)
        while self._ready:
            entity = self._ready.popleft()
            if not _exists(entity):
                continue  # a callback before has destroyed it
            if self._before_work is not None:
                self._before_work()
            entity.run()
            self._go_on()

    def _go_on(self) -> None:
        """Let tasks do what they can, in the order in which they came."""
        for task in self._tasks:
            task()
        if self._tasks:
            self._tasks = [task for task in self._tasks if not task.done()]

    def shutdown(self) -> None:
        """Leave the node; call it once, from no callback."""
        self._node.executor = None
        self._held.close()
        for guard in self._guards:
            guard.destroy()

    def _wait(self, timeout_sec: float) -> None:
        """Wait up to a time [s] and note what is ready."""
        if self._changed:
            self._changed = False
            self._gather()
        wait_set = self._wait_set
        wait_set.clear_entities()
        for guard in self._guards:
            wait_set.add_guard_condition(guard.handle)
        try:
            for entity in self._entities:
                entity.add_to(wait_set)
        except InvalidHandle:
            self._changed = True  # another thread has just destroyed it
            return
        wait_set.wait(int(timeout_sec * 1e9))
        if not self._context.ok():
            raise ExternalShutdownException
        self._ready.extend(entity for entity in self._entities if entity.is_ready(wait_set))

    def _gather(self) -> None:
        """Build a wait set of what the node has now."""
        self._held.close()  # what was destroyed meanwhile may go
        self._entities = [entity for entity in waited_entities(self._node) if self._hold(entity)]
        count = NumberOfEntities(num_gcs=len(self._guards))
        for entity in self._entities:
            count += entity.count
        with self._context.handle:
            self._wait_set = rclpy_implementation.WaitSet(
                count.num_subscriptions,
                count.num_guard_conditions,
                count.num_timers,
                count.num_clients,
                count.num_services,
                count.num_events,
                self._context.handle,
            )

    def _hold(self, entity: WaitedEntity | WaitedWaitable) -> bool:
        """Keep an entity from being destroyed while it is waited for; False if it has been."""
        try:
            self._held.enter_context(entity.handle)
        except InvalidHandle:
            return False
        return True


def _exists(entity: WaitedEntity | WaitedWaitable) -> bool:
    """Whether an entity has not been destroyed."""
    try:
        with entity.handle:
            return True
    except InvalidHandle:
        return False
