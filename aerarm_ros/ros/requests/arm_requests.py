"""Requests that the command `arm` sends to the bridge and to other nodes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
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
            self._request()
            self.status = 0
        except _HereError:
            self.status = HERE
        except ArmClientError as error:
            print_error(NAME, error)

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()


def _say_wait(what: str) -> None:
    print_notice(NAME, f'waiting for {what}')


def _action(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    """Return a function that calls the bridge's service with the same name as the command.

    This function creates the service client before the call, because discovery takes time.
    """
    bridges = options.bridge or (['fake_hardware'] if options.command == 'put_back' else [])
    actions = [options.command, *(['home'] if getattr(options, 'home', False) else [])]
    everywhere = getattr(options, 'all', False)
    client = ArmClient(node, bridges, actions, _say_wait, everywhere)

    def ask() -> None:
        if options.wait_before:
            # An arm that is already in the final mode need not reach the first one.
            modes = [options.wait_before, *(options.wait or ())]
            client.wait_for_mode(modes, options.timeout)
        action = options.command
        if getattr(options, 'home', False):
            client.wait_for_mode([*OFF, *(options.wait or ())], options.timeout)
            action = 'home' if client.mode == 'unhomed' else action
        if options.command in STOPS:
            for answer in client.stop(options.command, options.timeout):
                print_answer(answer)  # The stop continues even if the answer is lost.
        else:
            print(client.call(action, options.timeout), flush=True)
        if options.wait:
            client.wait_for_mode(options.wait, options.timeout)
            print(f'arm_mode {client.mode}', flush=True)

    return ask


def _motion(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    """Return a function that moves the joints or the tool, or presses the tool on a wall."""
    from aerarm_ros.ros.requests.motion_request import PressRequest, SetPointRequest, ToolRequest

    given = options
    act: Callable[[], str]
    if given.command == 'go':
        go = SetPointRequest(node).go
        act = partial(go, given.angle, given.tolerance, given.timeout, _say_wait, given.on_contact)
    elif given.command == 'tool':
        place = given.x, given.y, given.z
        move = ToolRequest(node).go
        act = partial(move, place, given.tolerance, given.timeout, _say_wait, given.frame)
    else:
        press = PressRequest(node).press
        act = partial(press, (given.x, given.y, given.z), given.timeout, _say_wait)
    return lambda: print(act(), flush=True)


def _set(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    from aerarm_ros.ros.requests.parameter_request import ParameterRequest

    def ask() -> None:
        request = ParameterRequest(node, options.node, options.timeout)
        value = request.set(options.name, options.value)
        print(f'{options.node}: {options.name} = {value}', flush=True)

    return ask


def _fault(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    options.node, options.name, options.value = options.bridge, 'fault', options.fault
    return _set(node, options)


def _record(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    from aerarm_ros.ros.requests.recording_request import RecordingRequest

    folder = Path(options.what).resolve()
    request = RecordingRequest(node, folder.name, folder, lambda text: print_notice(NAME, text))

    def ask() -> None:
        if not request.is_on_ground():
            if options.command == 'record':
                raise _HereError
            raise ArmClientError(
                f'the node ground_link does not run on this host in {this_domain()}: start '
                'ground_side.launch.py'
            )
        if options.command == 'record':
            request.record()
        else:
            request.fetch()

    return ask


class _HereError(Exception):
    """No `ground_link` runs, so the recorder must run on this host."""


def _commission(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    # Late import, because this command's model of the arm takes a second to load.
    from aerarm_ros.ros.requests.commissioning_client import CommissioningRun

    return CommissioningRun(node, options).run


def _calibrate(node: Node, options: argparse.Namespace) -> Callable[[], None]:
    from aerarm_ros.ros.programs.calibrate_arm import CalibrateArm

    return CalibrateArm(node, options).run


# Every other command calls the bridge's service of its name.
_REQUESTS: dict[str, Callable[[Node, argparse.Namespace], Callable[[], None]]] = {
    'go': _motion,
    'tool': _motion,
    'press': _motion,
    'set': _set,
    'fault': _fault,
    'record': _record,
    'fetch': _record,
    'commission': _commission,
    'calibrate': _calibrate,
}


def run_request(options: argparse.Namespace, args: Sequence[str] | None) -> int:
    """Send the request of an `arm` command; return its exit status, 0 if it succeeded."""
    return run_node(NAME, lambda: Arm(options), args)
