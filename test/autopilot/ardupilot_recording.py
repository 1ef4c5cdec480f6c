"""Recorded exchange between the real ArduCopter firmware and its simulator, and its replay.

`python test/autopilot/ardupilot_recording.py` records it again; the variable ARDUPILOT names the
folder of ArduPilot.
"""

import gzip
import json
import select
import socket
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from zlib import crc32

from px4_recording import BODY, DRONE, fly, known_frames

from aerarm_ros.autopilot.ardupilot_flight import ArduPilotFirmware
from aerarm_ros.autopilot.ardupilot_link import COMPANION_PORT, PORT_STEP, SIMULATOR_PORT, JsonLink
from aerarm_ros.autopilot.ardupilot_loop import ArduPilotSetPoints
from aerarm_ros.autopilot.ardupilot_setup import ArduPilotSetup, motors_of
from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.px4_link import CompanionLink
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.motion.signals import Array

RECORDING = Path(__file__).parents[1] / 'data' / 'ardupilot_start.json.gz'
SETUP = ArduPilotSetup()
_INSTANCE = 7


@dataclass
class Step:
    """A step of the simulator: checksums of its input, and its output in hexadecimal.

    Attributes
    ----------
    lines, companion : int
        Checksums of the sensor lines, and of the MAVLink frames before them.
    motors : list of str
        Motor packet after each sensor line.
    frames : list of str
        Known MAVLink frames that arrived during the step.
    """

    lines: int = 0
    companion: int = 0
    motors: list[str] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)


def load() -> tuple[str, list[Step]]:
    """Return the first motor packet, in hexadecimal, and the recorded steps."""
    with gzip.open(RECORDING, 'rt') as file:
        first, steps = json.load(file)
    return first, [Step(**step) for step in steps]


def flight(
    simulator: JsonLink, companion: CompanionLink
) -> tuple[FirmwareFlight, ArduPilotFirmware]:
    """Return the flight that is recorded and replayed, and its firmware."""
    firmware = ArduPilotFirmware(simulator, companion, motors_of(DRONE))
    lasting = SETUP.rate_i / SETUP.rate_p
    acceleration = SetPointAcceleration(SETUP.att_p, SETUP.rate_gain(DRONE), lasting)
    set_points = ArduPilotSetPoints(SETUP.loop, acceleration)
    return FirmwareFlight(DRONE, BODY, firmware, set_points), firmware


class NotingSocket(socket.socket):
    """UDP socket that keeps the last received datagram."""

    last = b''

    def recvfrom(self, size: int, flags: int = 0) -> tuple[bytes, tuple[str, int]]:
        self.last, sender = super().recvfrom(size, flags)
        return self.last, sender


class RecordingJson(JsonLink):
    """Simulator connection that records its input and output."""

    def __init__(self, port: int, steps: list[Step]) -> None:
        super().__init__(port)
        self._steps = steps
        self._line = NotingSocket(fileno=self._line.detach())
        self.first = ''

    def await_ardupilot(self) -> None:
        """Wait for ArduPilot's first packet, where a replay begins."""
        if not self._receive(60.0):
            raise TimeoutError('ArduPilot does not answer')

    def step(self, lines: Sequence[bytes]) -> Array | None:
        self._steps[-1].lines = crc32(b''.join(lines))
        return super().step(lines)

    def _receive(self, patience: float) -> bool:
        is_received = super()._receive(patience)
        packet = self._line.last.hex()
        if is_received and self.first:
            self._steps[-1].motors.append(packet)
        elif is_received:
            self.first = packet
        return is_received


class RecordingCompanion(CompanionLink):
    """Companion connection that records its output and the known received frames."""

    def __init__(self, port: int, steps: list[Step]) -> None:
        super().__init__(port, None)
        self._steps = steps

    def send(self, frame: bytes) -> None:
        super().send(frame)
        if self._peer is not None:
            self._steps[-1].companion = crc32(frame, self._steps[-1].companion)

    def messages(self, patience: float = 0.0) -> list[Message]:
        found = []
        while select.select([self._socket], [], [], patience)[0]:
            data, sender = self._socket.recvfrom(65536)
            # The first datagram shows the autopilot's address, whatever it contains.
            frames = [data] if self._peer is None else known_frames(data)
            self._peer = sender
            self._steps[-1].frames += [frame.hex() for frame in frames]
            for frame in frames:
                found += self._reader.feed(frame)
        self._steps.append(Step())  # the firmware reads messages at the end of its step
        return found


class ReplayedArduPilot(threading.Thread):
    """Replay a recording of ArduCopter, and check the received data byte by byte.

    Parameters
    ----------
    port, mavlink_port : int
        Ports of the simulator and of the companion.
    ends_at : int, optional
        Step at which ArduCopter falls silent.
    patience : float
        Time [s] without a sensor line after which the replay ends.

    Attributes
    ----------
    differing : list of int
        Steps whose input differs from that of the real ArduCopter.
    done : int
        Number of answered steps.
    """

    def __init__(
        self, port: int, mavlink_port: int, ends_at: int | None = None, patience: float = 10.0
    ) -> None:
        super().__init__(daemon=True)
        self._first, self._steps = load()
        self._ends_at = ends_at
        self._model, self._mavlink = ('127.0.0.1', port), ('127.0.0.1', mavlink_port)
        self._line, self._udp = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._line.settimeout(patience)
        self._udp.setblocking(False)
        self._line.sendto(bytes.fromhex(self._first), self._model)
        self.differing: list[int] = []
        self.done = 0

    def run(self) -> None:
        for number, step in enumerate(self._steps):
            if number == self._ends_at or not self._answer(number, step):
                break
            self.done += 1
        self._line.close()
        self._udp.close()

    def _answer(self, number: int, step: Step) -> bool:
        """Answer the sensor lines of a step; return False if the simulator has ended."""
        lines = 0
        for motors in step.motors:
            try:
                lines = crc32(self._line.recv(4096), lines)
            except TimeoutError:
                return False
            if motors is step.motors[-1]:
                if (lines, self._heard()) != (step.lines, step.companion):
                    self.differing.append(number)
                for frame in step.frames:
                    self._udp.sendto(bytes.fromhex(frame), self._mavlink)
            self._line.sendto(bytes.fromhex(motors), self._model)
        return True

    def _heard(self) -> int:
        """Return the checksum of the MAVLink frames received since the last call."""
        heard = 0
        while True:
            try:
                heard = crc32(self._udp.recv(65536), heard)
            except (BlockingIOError, ConnectionRefusedError):
                return heard


def record() -> None:
    """Record the start of the real firmware, and some steps in flight."""
    sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
    from flying.ardupilot_program import HOW, ArduPilotProgram, find_ardupilot

    path = find_ardupilot()
    if path is None:
        sys.exit(HOW)
    steps, more = [Step()], PORT_STEP * _INSTANCE
    with (
        tempfile.TemporaryDirectory() as folder,
        ArduPilotProgram(path, Path(folder), DRONE, BODY, SETUP, _INSTANCE),
    ):
        simulator = RecordingJson(SIMULATOR_PORT + more, steps)
        companion = RecordingCompanion(COMPANION_PORT + more, steps)
        simulator.await_ardupilot()
        control, firmware = flight(simulator, companion)
        fly(control)
        print(firmware.problem or 'in flight')
    steps = [step for step in steps if step.motors]
    with gzip.GzipFile(RECORDING, 'wb', mtime=0) as file:
        file.write(json.dumps([simulator.first, [asdict(step) for step in steps]]).encode())
    print(f'{len(steps)} steps, {RECORDING.stat().st_size // 1024} KiB')


if __name__ == '__main__':
    record()
