"""Recorded exchange between the real PX4 firmware and its simulator, and its replay.

`python test/autopilot/px4_recording.py` records it again; the variable PX4 names a build
directory.
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

import numpy as np

from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.autopilot.mavlink import LAYOUTS, FrameReader, Message
from aerarm_ros.autopilot.px4_flight import Px4Firmware
from aerarm_ros.autopilot.px4_link import CompanionLink, Controls, SimulatorLink
from aerarm_ros.autopilot.px4_set_points import Px4SetPoints, tilt_ahead
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.px4_program import HOW, Px4AllGains, Px4Program, Px4Setup, find_px4

RECORDING = Path(__file__).parents[1] / 'data' / 'px4_start.json.gz'
DRONE = load_drone_config()
BODY = MassProperties(4.49, np.array([0.0, 0.0, -0.05]), np.diag([0.2, 0.2, 0.1]))
SETUP = Px4Setup(Px4AllGains.scaled(1.5, 6.5, 2.0))
STILL = FlightState(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3))
FLOWN = 100  # steps in flight
_USED = 'HEARTBEAT', 'LOCAL_POSITION_NED', 'STATUSTEXT', 'TIMESYNC'
_KNOWN = {LAYOUTS[name].number for name in _USED}


def pushed(step: int) -> FeedForward:
    """Return the arm's feedforward in a step in flight."""
    wrench = np.array([np.sin(0.05 * step), 0.5, 0.0, 0.1, -0.2, 0.0])
    return FeedForward(BODY, wrench, wrench, np.array([0.1, 0.0, 0.0]), np.zeros(3))


def flight(simulator: SimulatorLink, companion: CompanionLink) -> FirmwareFlight:
    """Return the flight that is recorded and replayed."""
    set_points = Px4SetPoints(DRONE, None, tilt_ahead(SETUP.gains, DRONE))
    return FirmwareFlight(DRONE, BODY, Px4Firmware(simulator, companion), set_points)


@dataclass
class Step:
    """A step of the simulator: lengths and checksums of its input, and its output.

    UDP data `early` arrived before the sensors of the step, `late` after them; hexadecimal.
    """

    length: int = 0
    sensors: int = 0
    companion: int = 0
    early: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    answer: str = ''


def load() -> list[Step]:
    """Return the recorded steps."""
    with gzip.open(RECORDING, 'rt') as file:
        return [Step(**step) for step in json.load(file)]


class RecordingSimulator(SimulatorLink):
    """Simulator connection that records its input and output."""

    def __init__(self, port: int, steps: list[Step]) -> None:
        super().__init__(port)
        self._steps = steps

    def await_px4(self) -> None:
        """Wait until PX4 connects, where a replay begins."""
        self._connected(60.0)

    def step(self, time_us: int, frames: Sequence[bytes], patience: float) -> Controls | None:
        now = self._steps[-1]
        sent = b''.join(frames)
        now.length, now.sensors = len(sent), crc32(sent)
        line, heard = self._line, []
        assert line is not None

        class Spy:
            """Connection that records all received data."""

            def sendall(self, data: bytes) -> None:
                line.sendall(data)

            def fileno(self) -> int:
                return line.fileno()

            def recv(self, size: int) -> bytes:
                heard.append(line.recv(size))
                return heard[-1]

            def close(self) -> None:
                line.close()

        self._line = Spy()  # type: ignore[assignment]
        answer = super().step(time_us, frames, patience)
        self._line = line
        now.answer = b''.join(heard).hex()
        return answer


class RecordingCompanion(CompanionLink):
    """Companion connection that records its output and the known received frames."""

    def __init__(self, port: int, px4_port: int, steps: list[Step]) -> None:
        super().__init__(port, px4_port)
        self._steps, self._is_late = steps, False

    def send(self, frame: bytes) -> None:
        now = self._steps[-1]
        if now.length:  # the previous step has ended
            now = Step()
            self._steps.append(now)
        now.companion = crc32(frame, now.companion)
        super().send(frame)

    def messages(self, patience: float = 0.0) -> list[Message]:
        now, found = self._steps[-1], []
        select.select([self._socket], [], [], patience)
        while True:
            try:
                data = self._socket.recv(65536)
            except (BlockingIOError, ConnectionRefusedError):
                break
            for frame in known_frames(data):
                (now.late if now.length else now.early).append(frame.hex())
                found += self._reader.feed(frame)
        return found


def known_frames(data: bytes) -> list[bytes]:
    """Return the frames of known messages in a datagram."""
    found, at = [], 0
    while at + 12 <= len(data):
        length = 12 + data[at + 1]
        if int.from_bytes(data[at + 7 : at + 10], 'little') in _KNOWN:
            found.append(data[at : at + length])
        at += length
    return found


class ScriptedPx4(threading.Thread):
    """Replay a recording of PX4, and check the received data byte by byte.

    Parameters
    ----------
    steps : list of Step
    tcp, udp, companion : int
        Ports of the simulator, of this PX4, and of the companion.
    ends_at : int, optional
        Step in which PX4 ends without an answer.
    damaged : int, optional
        Step whose answer has a wrong bit.

    Attributes
    ----------
    differing : list of int
        Steps whose input differs from that of the real PX4.
    done : int
        Number of answered steps.
    """

    def __init__(
        self, steps: list[Step], tcp: int, udp: int, companion: int,
        ends_at: int | None = None, damaged: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        self._steps, self._ends_at, self._damaged = steps, ends_at, damaged
        self._companion = ('127.0.0.1', companion)
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(('127.0.0.1', udp))
        self._tcp = socket.create_connection(('127.0.0.1', tcp))
        self._reader, self._heard, self._bytes = FrameReader(), 0, b''
        self.differing: list[int] = []
        self.done = 0

    def run(self) -> None:
        while self.done < len(self._steps) and self.done != self._ends_at:
            ready = select.select([self._udp, self._tcp], [], [], 10.0)[0]
            if self._udp in ready:
                self._hear()
            elif self._tcp in ready and not self._advance():
                break  # the simulator has ended
            elif not ready:
                break
        self._tcp.close()
        self._udp.close()

    def _hear(self) -> None:
        """Receive a datagram; answer a TIMESYNC by the data recorded after it."""
        data = self._udp.recv(65536)
        self._heard = crc32(data, self._heard)
        if any(message.name == 'TIMESYNC' for message in self._reader.feed(data)):
            self._say(self._steps[self.done].early)

    def _advance(self) -> bool:
        data = self._tcp.recv(65536)
        self._bytes += data
        step = self._steps[self.done]
        if len(self._bytes) >= step.length:
            sent, self._bytes = self._bytes[: step.length], self._bytes[step.length :]
            while select.select([self._udp], [], [], 0.0)[0]:
                self._hear()
            if (crc32(sent), self._heard) != (step.sensors, step.companion):
                self.differing.append(self.done)
            self._heard = 0
            self._say(step.late)
            answer = bytearray.fromhex(step.answer)
            if self.done == self._damaged:
                answer[20] ^= 0x10
            self.done += 1
            self._tcp.sendall(bytes(answer))
        return bool(data)

    def _say(self, frames: list[str]) -> None:
        for frame in frames:
            self._udp.sendto(bytes.fromhex(frame), self._companion)


def record() -> None:
    """Record the start of the real firmware, and some steps in flight."""
    build = find_px4()
    if build is None:
        sys.exit(HOW)
    steps = [Step()]
    with (
        tempfile.TemporaryDirectory() as folder,
        Px4Program(build, Path(folder), DRONE, BODY, SETUP, 7),
    ):
        simulator = RecordingSimulator(4567, steps)
        companion = RecordingCompanion(14547, 14587, steps)
        simulator.await_px4()
        control = flight(simulator, companion)
        fly(control, steps)
    with gzip.GzipFile(RECORDING, 'wb', mtime=0) as file:
        file.write(json.dumps([asdict(step) for step in steps]).encode())
    print(f'{len(steps)} steps, {RECORDING.stat().st_size // 1024} KiB')


def fly(control: FirmwareFlight, steps: list[Step] | None = None, flown: int = FLOWN) -> list[str]:
    """Fly a firmware through take-off and some steps in flight; return its successive problems."""
    target, seen = FlightTarget.here(STILL), ['']

    def begin() -> None:
        if steps is not None and steps[-1].length:
            steps.append(Step())

    control.update(STILL, target, 0.004)
    while control.is_settling and 'has ended' not in control.problem:
        begin()
        control.settle()
        if control.problem != seen[-1]:
            seen.append(control.problem)
    for step in range(flown):
        begin()
        control.update(STILL, target, 0.004, pushed(step))
    return seen


if __name__ == '__main__':
    record()
