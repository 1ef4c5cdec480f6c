"""One request to a service of a bridge, from when it is sent until it is answered."""

from __future__ import annotations

import time
from math import inf

from rclpy._rclpy_pybind11 import RCLError
from rclpy.client import Client
from rclpy.exceptions import InvalidHandle
from rclpy.task import Future
from std_srvs.srv import Trigger

from aerarm_ros.hardware.gate.answer import Answer

ASK_AGAIN = 0.5  # [s]


class ServiceCall:
    """Asks when it is made; its owner polls while the node is spun, here or in another thread.

    Parameters
    ----------
    client
        Of a `std_srvs/Trigger` service that is ready.
    timeout
        Longest time for the answer [s].
    waits
        Whether to wait on for a bridge that is not seen any more: a host that is held up for
        seconds makes one look so, too.
    repeats
        Whether to ask again while nothing is answered: an answer to a client that the bridge has
        not discovered yet is lost. Only for what may be done twice.

    Attributes
    ----------
    is_answered
        Whether what `poll` returned is the bridge's own answer.
    """

    def __init__(
        self, client: Client, timeout: float, waits: bool = True, repeats: bool = False
    ) -> None:
        self.is_answered = False
        self._answer: Answer | None = None
        self._client = client
        self._timeout = timeout
        self._waits = waits
        self._interval = ASK_AGAIN if repeats else inf
        self._begin = self._asked = time.monotonic()
        self._futures: list[Future] = []
        self._problem = ''
        self._send()

    def poll(self) -> Answer | None:
        """Return what the bridge says, or why it says nothing; None while that is not known."""
        if self._answer is not None:
            return self._answer
        now = time.monotonic()
        answer = next((future.result() for future in self._futures if future.done()), None)
        if answer is not None:
            self.is_answered = True
            return self._end(bool(answer.success), answer.message)
        is_sent, is_late = bool(self._futures), now - self._begin > self._timeout
        if not is_sent and (is_late or self._interval == inf):
            return self._end(False, self._problem)
        if is_late:
            return self._end(False, f'no answer within {self._timeout:g} s: see arm_mode')
        if not self._waits and not self._client.service_is_ready():
            return self._end(False, 'it has ended')
        if now - self._asked > self._interval:
            self._asked = now
            self._send()
        return None

    def _send(self) -> None:
        try:
            self._futures.append(self._client.call_async(Trigger.Request()))
        except (RCLError, InvalidHandle) as error:
            # Whoever asks several bridges goes on to the others.
            self._problem = f'it cannot be asked: {error}'

    def _end(self, accepted: bool, message: str) -> Answer:
        self._answer = Answer(accepted, message)
        for future in self._futures:
            if not future.done():
                self._client.remove_pending_request(future)
        return self._answer
