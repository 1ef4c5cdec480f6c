"""The guided procedure of `arm commission`, run for the page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node

from aerarm_ros.commissioning.commissioning_step import Prompt
from aerarm_ros.ros.executors.spinning import this_domain
from aerarm_ros.ros.requests.commissioning_client import CommissioningClient, EmulatedPerson

_PERIOD = 0.03  # [s]
_BRIDGE_TIMEOUT = 5.0  # [s]
_STOPPED = 'stopped: the motors are off'


class PageCommissioning:
    """Leads through one procedure at a time, in a thread of its own.

    Pictures may be rare and the drawing of them slow; the bridge wants ten requests per second.

    Parameters
    ----------
    node
        An executor must spin it in another thread.
    config, urdf
        Files of the arm, '' for the packaged ones.
    is_watched
        Tells whether somebody looks at the page: else the procedure ends, and the motors are off.

    Attributes
    ----------
    outcome
        Whether the last procedure ended well, and what came of it; '' before and during one.
    """

    def __init__(self, node: Node, config: str, urdf: str, is_watched: Callable[[], bool]) -> None:
        self.outcome = False, ''
        self._node = node
        self._files = config, urdf
        self._is_watched = is_watched
        self._lock = threading.Lock()  # clicks are served by several threads
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._client: CommissioningClient | None = None

    @property
    def runs(self) -> bool:
        """Whether a procedure is under way."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def prompt(self) -> Prompt | None:
        """What a person has to confirm now, None if nothing."""
        return self._client.prompt if self.runs and self._client is not None else None

    @property
    def news(self) -> list[str]:
        """Lines of the last procedure: joints begun, findings, verdicts."""
        guided = self._client.guided if self._client is not None else None
        return [] if guided is None else list(guided.news)

    @property
    def record(self) -> str:
        """File in which the verdicts are, '' before there are any."""
        client = self._client
        has_any = client is not None and client.guided is not None and client.guided.record.joints
        return str(client.path) if client is not None and has_any else ''

    def begin(self, joints: Sequence[str], resume: bool, emulated: str = '') -> None:
        """Begin with joints, all if none is named; with `resume` those that have not passed.

        On the bridge `emulated`, if one is named, an emulated hand does and confirms everything.
        Raises RuntimeError if a procedure is under way.
        """
        with self._lock:
            if self.runs:
                raise RuntimeError('commissioning is under way')
            self._stop.clear()
            self.outcome, self._client = (False, ''), None
            arguments = (joints, resume, emulated)
            self._thread = threading.Thread(target=self._run, args=arguments, daemon=True)
            self._thread.start()

    def answer(self, prompt: Prompt, yes: bool) -> None:
        """Answer a prompt, unless it is another by now: a double click confirms only one."""
        with self._lock:
            guided = self._client.guided if self._client is not None else None
            if guided is not None and guided.prompt is prompt:
                guided.answer(yes)

    def end(self) -> None:
        """Stop, wait until the bridge was asked to switch the motors off."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, joints: Sequence[str], resume: bool, emulated: str) -> None:
        client = None
        try:
            client = CommissioningClient(self._node, *self._files)
            self._find_bridge(client)
            client.begin(joints, resume)
            self._client = client
            self._lead(client, emulated)
            self.outcome = client.outcome
        except (ValueError, OSError) as error:
            self.outcome = False, str(error)
        finally:
            if client is not None:
                client.end()
                client.destroy()

    def _find_bridge(self, client: CommissioningClient) -> None:
        deadline = time.monotonic() + _BRIDGE_TIMEOUT
        while client.report is None:
            client.poll()
            self._pause()
            if time.monotonic() > deadline:
                raise ValueError(f'no bridge answers: is one active in {this_domain()}?')

    def _lead(self, client: CommissioningClient, emulated: str) -> None:
        if emulated and not (client.report and client.report.emulated):
            raise ValueError('an emulated hand turns emulated joints only')
        person = EmulatedPerson(self._node, client, emulated) if emulated else None
        while client.is_on:
            with self._lock:
                client.poll()
                if client.problem:
                    raise ValueError(f'{client.problem}: see its console')
                if person is not None:
                    person.poll()
            self._pause()
        client.poll()  # an answer may have ended the last joint

    def _pause(self) -> None:
        """Wait for the next turn; raises ValueError if there is none."""
        if self._stop.wait(_PERIOD):
            raise ValueError(_STOPPED)
        if not self._is_watched():
            raise ValueError(f'the page was closed, {_STOPPED}')
