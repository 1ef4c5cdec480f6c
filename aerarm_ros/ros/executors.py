"""Executor that spins a node in a background thread, and functions for spinning and timers."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

import rclpy
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.service import Service
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.subscription import Subscription
from rclpy.task import Task
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable

from aerarm_ros.ros.process.process_end import StopSignals


class WaitedEntity:
    """Adapter that adds a timer, subscription, guard condition, client or service to a wait set.

    Parameters
    ----------
    kind
        Name of the kind of entity in rclpy's wait sets.
    handle
        Handle of the entity; as a context it prevents destruction of the entity.
    run
        Reads the received data and calls the callback.

    Attributes
    ----------
    count
        Number of entries in a wait set, by kind.
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
        """Add the entity to a wait set."""
        self._index = getattr(wait_set, self._add)(self.handle)

    def is_ready(self, wait_set: Any) -> bool:
        """Return whether the entity was ready at the end of the last wait."""
        return bool(wait_set.is_ready(self._kind, self._index))


class WaitedWaitable:
    """Adapter that adds a waitable of rclpy, such as a publisher's events, to a wait set."""

    def __init__(self, waitable: Waitable) -> None:
        self.handle = waitable
        self.count = waitable.get_num_entities()
        self.add_to = waitable.add_to_wait_set
        self.is_ready = waitable.is_ready

    def run(self) -> None:
        """Read the data and call the callback, which must not wait."""
        coroutine = self.handle.execute(self.handle.take_data())
        try:
            coroutine.send(None)
        except StopIteration:
            return
        coroutine.close()
        raise RuntimeError(
            f'a callback of {self.handle} waits as a coroutine, which this executor does not '
            'support: use a plain function'
        )


def waited_entities(node: Node) -> Iterator[WaitedEntity | WaitedWaitable]:
    """Yield an adapter for each entity of a node whose callback group permits a callback now."""
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
        return  # no task waits for this response any more
    future.set_result(response)


def _run_service(service: Service) -> None:
    request, header = service.handle.service_take_request(service.srv_type.Request)
    if header is not None:
        service.send_response(service.callback(request, service.srv_type.Response()), header)


class LeanExecutor:
    """Executor for one node that takes less processor time than rclpy's executors.

    rclpy's executors build several wait sets for each callback. This executor builds a new wait set
    only after changes. A parameter request takes 0.5 to 1 ms of the interpreter's time in rclpy's
    executor, and a third of this time in LeanExecutor. Callbacks run one after the other, in any
    group. Entities in a group that permits no callback, such as those of a RawReader, are ignored.
    Callbacks must not be coroutines, but the function of an action server may be one.

    Parameters
    ----------
    node
        Node whose callbacks run.
    before_work
        Called before each callback; may block to delay the callback.
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

    # Methods that a node calls on its executor.

    def add_node(self, node: Node) -> None:
        """Do nothing, because this executor spins only the node of its constructor."""

    def remove_node(self, node: Node) -> None:
        """Do nothing, because `shutdown` removes the node."""

    def create_task(self, callback: Callable[..., Any], *args: Any) -> Task:
        """Start a function or coroutine after the present callback.

        Only a callback may call this method. A coroutine continues only after callbacks, so a
        callback should provide the result for which the coroutine waits.
        """
        task = Task(callback, args, executor=None)
        self._tasks.append(task)
        return task

    def wake(self) -> None:
        """End a wait, because the node's entities or other data have changed."""
        self._changed = True
        with suppress(InvalidHandle):  # after `shutdown`
            self._guards[0].trigger()

    # Methods that the executor's owner calls.

    def spin_once(self, timeout_sec: float) -> None:
        """Wait up to `timeout_sec` [s] for an entity to become ready, and run its callback.

        Raises ExternalShutdownException if the context was shut down, and all exceptions of
        callbacks. The next call runs the other callbacks that were ready.
        """
        # A guard condition is ready only once, so run the stored entities first.
        if not self._ready:
            self._wait(timeout_sec)
        while self._ready:
            entity = self._ready.popleft()
            if not _exists(entity):
                continue  # destroyed by an earlier callback
            if self._before_work is not None:
                self._before_work()
            entity.run()
            self._continue_tasks()

    def _continue_tasks(self) -> None:
        """Continue all unfinished tasks from `create_task`, in the order of their start."""
        for task in self._tasks:
            task()
        if self._tasks:
            self._tasks = [task for task in self._tasks if not task.done()]

    def shutdown(self) -> None:
        """Remove the node from this executor; to be called once, outside callbacks."""
        self._node.executor = None
        self._held.close()
        for guard in self._guards:
            guard.destroy()

    def _wait(self, timeout_sec: float) -> None:
        """Wait up to `timeout_sec` [s] for ready entities, and store them."""
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
            self._changed = True  # another thread has just destroyed the entity
            return
        wait_set.wait(int(timeout_sec * 1e9))
        if not self._context.ok():
            raise ExternalShutdownException
        self._ready.extend(entity for entity in self._entities if entity.is_ready(wait_set))

    def _gather(self) -> None:
        """Build a new wait set for the node's present entities."""
        self._held.close()  # releases entities that were destroyed meanwhile
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
        """Prevent an entity's destruction during a wait; return False if it no longer exists."""
        try:
            self._held.enter_context(entity.handle)
        except InvalidHandle:
            return False
        return True


def _exists(entity: WaitedEntity | WaitedWaitable) -> bool:
    """Return whether an entity still exists."""
    try:
        with entity.handle:
            return True
    except InvalidHandle:
        return False


# [s] Longest time for which a thread that wakes for its cycle waits for Python's interpreter;
# Python's default is 5 ms. With a shorter interval the threads switch too often.
SWITCH_INTERVAL = 50e-6
# The same for callbacks that run in the idle time of a cycle: they may end without a switch.
SWITCH_INTERVAL_IN_SLACK = 500e-6  # decision 16
WAIT = 5.0  # [s]; each wake-up costs the main loop half a millisecond


class BackgroundExecutor:
    """Context in which a second thread spins a node.

    Enter the context before the call of `set_fifo`. That function sets the second thread's priority
    one below the priority of the loop.

    Parameters
    ----------
    node
        Node to spin. The executor ignores subscriptions of a RawReader, which the loop reads.
    before_work
        Called before each callback. It blocks until the end of a cycle, so that the callback does
        not disturb the loop. Without it, callbacks run at any time.
    """

    def __init__(self, node: Node, before_work: Callable[[], None] | None = None) -> None:
        self._node = node
        self._context = node.context
        # rclpy's Executor.wake() only restarts the wait; this guard condition ends it.
        self._end = node.create_guard_condition(lambda: None)
        self._executor = LeanExecutor(node, before_work)
        self._switch_interval = SWITCH_INTERVAL_IN_SLACK if before_work else SWITCH_INTERVAL
        self._stopped = False
        self._thread = threading.Thread(target=self._spin, name='ros', daemon=True)

    def __enter__(self) -> BackgroundExecutor:
        sys.setswitchinterval(self._switch_interval)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped = True
        self._end.trigger()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_guard_condition(self._end)

    def _spin(self) -> None:
        # Executor.spin() can miss a shutdown that arrives while it prepares to wait, and then never
        # returns. This loop checks again.
        with contextlib.suppress(KeyboardInterrupt):
            while not self._stopped:
                try:
                    self._executor.spin_once(timeout_sec=WAIT)
                except ExternalShutdownException:
                    return
                except Exception:
                    # A shutdown can invalidate the context in the middle of a call.
                    if not self._context.ok():
                        return
                    # An error in one callback must not stop the e-stop service.
                    traceback.print_exc()


_SPIN, _POLL = 0.05, 0.02  # [s]


def spin_until(node: Node | None, condition: Callable[[], object], timeout: float) -> bool:
    """Spin a node until a condition is true; return False after `timeout` [s].

    No executor may contain the node. Without a node, another thread must make the condition true.
    """
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        if node is None:
            time.sleep(_POLL)
        else:
            rclpy.spin_once(node, timeout_sec=_SPIN)
    return True


_STOP_DELAY = 0.1  # [s] longest delay until a stop signal takes effect


def run_until_stopped(node: Node) -> None:
    """Run the callbacks of a node until SIGINT, SIGTERM, SIGHUP or a shutdown."""
    executor, stopped = SingleThreadedExecutor(), threading.Event()
    executor.add_node(node)
    with StopSignals(stopped.set):
        while not stopped.is_set() and rclpy.ok():
            executor.spin_once(timeout_sec=_STOP_DELAY)


def this_domain() -> str:
    """Return ROS domain and discovery range as text, for messages about missing nodes."""
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    where = 'on this host only; ground_link connects hosts'
    if os.environ.get('AERARM_NETWORK') == 'open':
        where = 'with all hosts on which AERARM_NETWORK=open is set'
    return f'this ROS domain (ROS_DOMAIN_ID={domain}, {where})'


def create_steady_timer(
    node: Node, period: float, act: Callable[[], None], autostart: bool = True
) -> Timer:
    """Create a timer of a node; the timer uses the monotonic clock.

    rclpy's timers use the system clock by default. If the system clock is set back by 2 s, such a
    timer pauses for 2 s.

    Parameters
    ----------
    node
        Owner of the timer.
    period
        Period of the calls [s].
    act
        Function that the node's executor calls periodically.
    autostart
        Whether the timer starts now; otherwise it starts with its first `reset`.
    """
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period, act, clock=clock, autostart=autostart)
