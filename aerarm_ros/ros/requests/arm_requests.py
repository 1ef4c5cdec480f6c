"""Requests that the command `arm` sends to the bridge and to other nodes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from rclpy.node import Node

from aerarm_ros.hardware.bridge_modes import OFF, STOPS
from aerarm_ros.ros.executors import this_domain
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import print_answer, print_error, print_notice
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

NAME = 'arm'
HERE = 64
"""Exit status of `arm record` if the recorder must run on this host, as no `ground_link` runs."""

Request = Callable[[], int | None]
"""Function that sends a request and prints the result; returns an exit status, None for 0."""


class Arm:
    """Node that sends the request of one `arm` command and prints the result.

    Attributes
    ----------
    status
        Exit status after `run`; 0 if the request succeeded.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.status = 1
        self._node = rclpy.create_node(NAME)
        self._request = _REQUESTS.get(options.command, _action)(self._node, options)

    def run(self) -> None:
        """Send the request and print the result."""
        try:
            self.status = self._request() or 0
        except ArmClientError as error:
            print_error(NAME, error)

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()


def _say_wait(what: str) -> None:
    print_notice(NAME, f'waiting for {what}')


# Each function creates the clients of its command before the request, because discovery takes time.


def _action(node: Node, options: argparse.Namespace) -> Request:
    """Return a function that calls the bridge's service with the same name as the command."""
    action, homes = options.command, getattr(options, 'home', False)
    bridges = options.bridge or (['fake_hardware'] if action == 'put_back' else [])
    actions = [action, 'home'] if homes else [action]
    client = ArmClient(node, bridges, actions, _say_wait, getattr(options, 'all', False))

    def ask() -> None:
        # An arm that is already in the final mode need not reach the first one.
        final = options.wait or []
        if options.wait_before:
            client.wait_for_mode([options.wait_before, *final], options.timeout)
        if homes:
            client.wait_for_mode([*OFF, *final], options.timeout)
        if action in STOPS:
            for answer in client.stop(action, options.timeout):
                print_answer(answer)  # The stop continues even if the answer is lost.
        else:
            is_unhomed = homes and client.mode == 'unhomed'
            print(client.call('home' if is_unhomed else action, options.timeout), flush=True)
        if final:
            client.wait_for_mode(final, options.timeout)
            print(f'arm_mode {client.mode}', flush=True)

    return ask


def _motion(node: Node, options: argparse.Namespace) -> Request:
    """Return a function that moves the joints or the tool, or presses the tool on a wall."""
    from aerarm_ros.ros.requests.motion_request import PressRequest, SetPointRequest, ToolRequest

    kind = {'go': SetPointRequest, 'tool': ToolRequest, 'press': PressRequest}[options.command]
    request = kind(node, _say_wait)

    def ask() -> None:
        timeout = options.timeout
        if isinstance(request, SetPointRequest):
            result = request.go(options.angle, options.tolerance, timeout, options.on_contact)
        elif isinstance(request, ToolRequest):
            place = options.x, options.y, options.z
            result = request.go(place, options.tolerance, timeout, options.frame)
        else:
            result = request.press((options.x, options.y, options.z), timeout)
        print(result, flush=True)

    return ask


def _set(node: Node, options: argparse.Namespace) -> Request:
    from aerarm_ros.ros.requests.parameter_request import ParameterRequest

    if options.command == 'fault':
        options.node, options.name, options.value = options.bridge, 'fault', options.fault

    def ask() -> None:
        request = ParameterRequest(node, options.node, options.timeout)
        value = request.set(options.name, options.value)
        print(f'{options.node}: {options.name} = {value}', flush=True)

    return ask


def _record(node: Node, options: argparse.Namespace) -> Request:
    from aerarm_ros.ros.requests.recording_request import RecordingRequest

    folder = Path(options.what).resolve()
    request = RecordingRequest(node, folder.name, folder, lambda text: print_notice(NAME, text))

    def ask() -> int | None:
        records = options.command == 'record'
        if request.is_on_ground():
            act = request.record if records else request.fetch
            act()
        elif records:
            return HERE
        else:
            raise ArmClientError(
                f'the node ground_link does not run on this host in {this_domain()}: start '
                'ground_side.launch.py'
            )
        return None

    return ask


def _commission(node: Node, options: argparse.Namespace) -> Request:
    # Late import, because this command's model of the arm takes a second to load.
    from aerarm_ros.ros.requests.commissioning_client import CommissioningRun

    return CommissioningRun(node, options).run


def _calibrate(node: Node, options: argparse.Namespace) -> Request:
    from aerarm_ros.ros.programs.calibrate_arm import CalibrateArm

    return CalibrateArm(node, options).run


# Every other command calls the bridge's service of its name.
_REQUESTS: dict[str, Callable[[Node, argparse.Namespace], Request]] = {
    **dict.fromkeys(('go', 'tool', 'press'), _motion),
    **dict.fromkeys(('set', 'fault'), _set),
    **dict.fromkeys(('record', 'fetch'), _record),
    'commission': _commission,
    'calibrate': _calibrate,
}


def run_request(options: argparse.Namespace, args: Sequence[str] | None) -> int:
    """Send the request of an `arm` command; return its exit status, 0 if it succeeded."""
    return run_node(NAME, lambda: Arm(options), args)
