import threading
import time

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from aerarm_ros.ros import executors
from aerarm_ros.ros.executors import BackgroundExecutor


def test_serves_the_node_while_the_main_thread_is_busy(ros_node: Node) -> None:
    ros_node.declare_parameter('gain', 2.5)
    client = ros_node.create_client(GetParameters, 'test/get_parameters')
    answered = threading.Event()
    with BackgroundExecutor(ros_node):
        future = client.call_async(GetParameters.Request(names=['gain']))
        future.add_done_callback(lambda _: answered.set())
        end = time.monotonic() + 60.0
        while not answered.is_set() and time.monotonic() < end:
            sum(range(1000))
    assert future.result().values[0].double_value == 2.5


def test_ends_at_once_though_nothing_happens_on_the_node(ros_node: Node, monkeypatch) -> None:
    monkeypatch.setattr(executors, 'WAIT', 3600.0)
    before = threading.active_count()
    with BackgroundExecutor(ros_node):
        assert threading.active_count() == before + 1
        time.sleep(0.2)  # by now it waits; without a signal it would for an hour
    assert threading.active_count() == before


def test_survives_a_context_that_goes_away(ros_domain) -> None:
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('test', context=context)
    failed = []
    threading.excepthook, before = failed.append, threading.excepthook
    try:
        with BackgroundExecutor(node):
            rclpy.shutdown(context=context)
    finally:
        threading.excepthook = before
    assert not failed
