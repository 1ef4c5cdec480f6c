"""Processor time per parameter request, for several executors of the node that responds.

Each executor serves one node in a second thread of a separate process, as next to a control loop. A
client repeatedly requests a parameter, and the node reports the processor time used. A subscription
in a callback group that never runs represents one that the loop reads itself.
"""

import argparse
import subprocess
import sys
import threading
import time

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String
from std_srvs.srv import Trigger
from timing.waiting import wait_until

from aerarm_msgs_py.live_topics import HiddenFromExecutors
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.process.node_process import ros_environment

KINDS = ('lean', 'rclpy', 'events')
PATIENCE = 60.0  # [s]


def serve(kind: str) -> None:
    """Respond to requests until standard input ends."""
    rclpy.init(args=[])
    node = rclpy.create_node('server')
    taken: list[object] = []

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = f'{time.process_time()} {len(taken)}'
        return response

    node.create_service(Trigger, '~/cost', answer)
    node.create_subscription(
        String, '~/read_by_loop', taken.append, 10, callback_group=HiddenFromExecutors()
    )
    if kind == 'lean':
        with BackgroundExecutor(node):
            sys.stdin.read()
    else:
        # Not spin(), because that of EventsExecutor never returns and blocks the interpreter.
        executor = SingleThreadedExecutor() if kind == 'rclpy' else EventsExecutor()
        executor.add_node(node)
        end = threading.Event()
        thread = threading.Thread(target=spin, args=(executor, end), daemon=True)
        thread.start()
        sys.stdin.read()
        end.set()
        thread.join()
        executor.shutdown()
    rclpy.try_shutdown()


def spin(executor: Executor, end: threading.Event) -> None:
    """Spin until the event, which is checked ten times per second."""
    while not end.is_set():
        executor.spin_once(timeout_sec=0.1)


def ask(node: Node, future: rclpy.Future) -> object:
    """Return the response to a request."""
    rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
    if not future.done():
        raise TimeoutError('no answer')
    return future.result()


def measure(node: Node, kind: str, count: int) -> str:
    """Return the processor time per request, and other results, of a server with an executor."""
    command = [sys.executable, __file__, '--serve', kind]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ros_environment()
    ) as server:
        cost = node.create_client(Trigger, '/server/cost')
        parameters = AsyncParameterClient(node, '/server')
        publisher = node.create_publisher(String, '/server/read_by_loop', 10)
        if not (cost.wait_for_service(PATIENCE) and parameters.wait_for_services(PATIENCE)):
            raise TimeoutError(f'{kind} was not found')
        wait_until(lambda: publisher.get_subscription_count() == 1)

        def spent() -> tuple[float, int]:
            answer = ask(node, cost.call_async(Trigger.Request()))
            seconds, taken = answer.message.split()  # type: ignore[attr-defined]
            return float(seconds), int(taken)

        ask(node, parameters.get_parameters(['use_sim_time']))
        for _ in range(5):
            publisher.publish(String(data='x'))
        before, _ = spent()
        for _ in range(count):
            ask(node, parameters.get_parameters(['use_sim_time']))
        after, taken = spent()
        assert server.stdin
        begin = time.monotonic()
        said, _ = server.communicate('', timeout=PATIENCE)
        end = time.monotonic() - begin
    return (
        f'{kind:8} {1e3 * (after - before) / count:6.2f} ms per request, {taken} of 5 messages '
        f'taken from the loop, ended after {end:.1f} s with status {server.returncode} '
        f'{said.strip()}'
    )


def main() -> None:
    """Measure all executors and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=1000, help='number of requests')
    parser.add_argument('--serve', choices=KINDS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve)
        return
    rclpy.init(args=[])
    node = rclpy.create_node('client')
    for kind in KINDS:
        print(measure(node, kind, options.count), flush=True)
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
