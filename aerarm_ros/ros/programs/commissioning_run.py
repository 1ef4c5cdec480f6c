"""`arm commission`: the guided procedure in a terminal."""

from __future__ import annotations

import argparse
import os
import select
import sys

import rclpy
from rclpy.node import Node

from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.commissioning_client import CommissioningClient, EmulatedPerson

_SPIN = 0.02  # [s]
_ANSWERS = '[y: done, n: skip this step, Ctrl-C: stop, motors off]'


class CommissioningRun:
    """Prompt a person, and print the findings.

    Parameters
    ----------
    node
        Node without executor.
    options
        Options of `arm commission`.
    """

    def __init__(self, node: Node, options: argparse.Namespace) -> None:
        self._node, self._options = node, options
        self._client = CommissioningClient(node, options.config, options.urdf, options.record)
        self._person = EmulatedPerson(node, self._client, options.bridge) if options.yes else None
        self._typed = ''
        self._asked: object = None
        self._printed = 0

    def run(self) -> None:
        """Run the procedure; the motors are off afterwards in every case.

        Raises
        ------
        ArmClientError
            If no bridge runs, the bridge stops answering, or a joint does not pass.
        """
        client, options = self._client, self._options
        try:
            self._find_bridge()
            client.begin(options.joint, options.resume)
            self._lead()
        except ValueError as error:
            raise ArmClientError(str(error)) from None
        finally:
            client.end()
        passed, text = client.outcome
        if not passed:
            record = f' --record {options.record}' if options.record else ''
            raise ArmClientError(f"{text}, continue with 'arm commission --resume{record}'")
        print(text, flush=True)

    def _find_bridge(self) -> None:
        client = self._client

        def has_reported() -> bool:
            client.poll()
            return client.report is not None

        if not spin_until(self._node, has_reported, self._options.timeout):
            raise ArmClientError(
                'no bridge responds to commissioning_request: check that one is active in '
                f'{this_domain()}'
            )
        if self._person is not None and not (client.report and client.report.emulated):
            raise ArmClientError(
                '--yes is for emulated boards only: on a real arm a person has to turn the '
                'joints, and to check that nothing is in the way of the arm'
            )

    def _lead(self) -> None:
        client = self._client
        while client.is_on:
            rclpy.spin_once(self._node, timeout_sec=_SPIN)
            client.poll()
            self._print_news()
            if client.problem:
                raise ArmClientError(f'{client.problem}: check the log of the bridge')
            self._ask()
            if self._person is not None:
                self._person.poll()
            else:
                self._read_answer()
        client.poll()  # an answer may have ended the last joint
        self._print_news()

    def _print_news(self) -> None:
        guided = self._client.guided
        news = guided.news if guided is not None else []
        for line in news[self._printed :]:
            print(line, flush=True)
        self._printed = len(news)

    def _ask(self) -> None:
        prompt = self._client.prompt
        if prompt is not None and prompt is not self._asked:
            self._asked = prompt
            print(f'  {prompt.text} {_ANSWERS}', flush=True)

    def _read_answer(self) -> None:
        """Read a typed line; the end of the input ends the procedure."""
        guided = self._client.guided
        if guided is None or self._client.prompt is None:
            return
        if '\n' not in self._typed and select.select([sys.stdin], [], [], 0.0)[0]:
            read = os.read(sys.stdin.fileno(), 256).decode(errors='replace')
            if not read:
                raise ArmClientError(
                    'the terminal was closed: the procedure has stopped, motors off'
                )
            self._typed += read
        line, newline, rest = self._typed.partition('\n')
        if not newline:
            return
        # One line per prompt: a line typed in advance answers the next prompt.
        self._typed = rest
        answer = line.strip().lower()
        if answer in ('y', 'yes', 'n', 'no'):
            guided.answer(answer.startswith('y'))
        else:
            print_notice('arm', f'{answer!r} is not a valid answer, type y or n')
