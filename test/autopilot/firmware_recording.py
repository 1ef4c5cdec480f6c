"""Recorded exchange between the firmware of PX4 or ArduCopter and its simulator, and its replay.

`python test/autopilot/firmware_recording.py px4` records it again; the variable PX4 names a build
directory. With `ardupilot` the variable ARDUPILOT names the folder of ArduPilot.
"""

import gzip
import json
import select
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

from aerarm_ros.autopilot.ardupilot import ArduPilotSetPoints, ArduPilotSetup
from aerarm_ros.autopilot.ardupilot_flight import ArduPilotFirmware
from aerarm_ros.autopilot.firmware_flight import FirmwareFlight, LockstepFirmware
from aerarm_ros.autopilot.mavlink import LAYOUTS, FrameReader
from aerarm_ros.autopilot.px4 import Px4SetPoints, tilt_ahead
from aerarm_ros.autopilot.px4_flight import Px4Firmware
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.firmware_program import (
    HOW,
    ArduPilotProgram,
    Px4AllGains,
    Px4Program,
    find_ardupilot,
    find_px4,
)

DATA = Path(__file__).parents[1] / 'data'
PX4, ARDUPILOT = 'px4', 'ardupilot'
DRONE = load_drone_config()
BODY = MassProperties(4.49, np.array([0.0, 0.0, -0.05]), np.diag([0.2, 0.2, 0.1]))
GAINS = Px4AllGains.scaled(1.5, 6.5, 2.0)
STILL = FlightState(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3))
FLOWN = 100  # steps in flight
_USED = 'HEARTBEAT', 'LOCAL_POSITION_NED', 'STATUSTEXT', 'TIMESYNC'
_KNOWN = {LAYOUTS[name].number for name in _USED}
_INSTANCE = 7


@dataclass
class Step:
    """A step of the simulator: checksums of its input, and its output in hexadecimal.

    The input is the sensor data `sent`, of a `length` if the connection is a stream, and the
    MAVLink frames `companion` before them. The output is an answer to each piece of sensor data,
    and MAVLink frames: `early` ones arrived before the sensor data, `late` ones after them.
    """

    length: int = 0
    sent: int = 0
    companion: int = 0
    early: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    answers: list[str] = field(default_factory=list)


def load(name: str) -> tuple[str, list[Step]]:
    """Return data that the firmware sends first, in hexadecimal, and the recorded steps."""
    with gzip.open(DATA / f'{name}_start.json.gz', 'rt') as file:
        first, steps = json.load(file)
    return first, [Step(**step) for step in steps]


def flight(firmware: LockstepFirmware) -> FirmwareFlight:
    """Return the flight that is recorded and replayed."""
    setup = ArduPilotSetup()
    if isinstance(firmware, Px4Firmware):
        set_points = Px4SetPoints(DRONE, None, tilt_ahead(GAINS, DRONE))
    else:
        set_points = ArduPilotSetPoints(setup.loop, setup.tilt_ahead(DRONE))
    return FirmwareFlight(DRONE, BODY, firmware, set_points)


def fly(control: FirmwareFlight, flown: int = FLOWN) -> list[str]:
    """Fly a firmware through take-off and some steps in flight; return its successive problems."""
    target, seen = FlightTarget.here(STILL), ['']
    control.update(STILL, target, 0.004)
    while control.is_settling and 'has ended' not in control.problem:
        control.settle()
        if control.problem != seen[-1]:
            seen.append(control.problem)
    for step in range(flown):
        wrench = np.array([np.sin(0.05 * step), 0.5, 0.0, 0.1, -0.2, 0.0])
        arm = FeedForward(BODY, wrench, wrench, np.array([0.1, 0.0, 0.0]), np.zeros(3))
        control.update(STILL, target, 0.004, arm)
    return seen


class Replay(threading.Thread):
    """Replay a recording of a firmware, and check the received data byte by byte.

    Parameters
    ----------
    name : str
        `PX4` or `ARDUPILOT`.
    model, companion : int
        Ports of the simulator and of the companion.
    own : int
        UDP port of the firmware for the companion; 0 for any.
    ends_at, damaged : int
        Step in which the firmware ends without an answer, and step whose answer has a wrong bit; -1
        for none.
    patience : float
        Time [s] without sensor data after which the replay ends.

    Attributes
    ----------
    differing : list of int
        Steps whose input differs from that of the real firmware.
    done : int
        Number of answered steps.
    """

    def __init__(
        self, name: str, model: int, companion: int, own: int = 0, ends_at: int = -1,
        damaged: int = -1, patience: float = 10.0,
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        first, self.steps = load(name)
        self._ends_at, self._damaged, self._patience = ends_at, damaged, patience
        self._companion = ('127.0.0.1', companion)
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(('127.0.0.1', own))
        kind = socket.SOCK_STREAM if name == PX4 else socket.SOCK_DGRAM
        self._model = socket.socket(socket.AF_INET, kind)
        self._model.connect(('127.0.0.1', model))
        self._model.send(bytes.fromhex(first))
        self._reader, self._heard, self._stream = FrameReader(), 0, b''
        self.differing: list[int] = []
        self.done = 0

    def run(self) -> None:
        for step in self.steps:
            if self.done == self._ends_at or not self._advance(step):
                break
            self.done += 1
        self._model.close()
        self._udp.close()

    def _advance(self, step: Step) -> bool:
        """Answer the sensor data of a step; return False if the simulator has ended."""
        sent = 0
        for number, answer in enumerate(step.answers, 1):
            data = self._sensors(step)
            if data is None:
                return False
            sent, output = crc32(data, sent), bytearray.fromhex(answer)
            if number == len(step.answers):
                while select.select([self._udp], [], [], 0.0)[0]:
                    self._hear(step)
                if (sent, self._heard) != (step.sent, step.companion):
                    self.differing.append(self.done)
                self._heard = 0
                self._say(step.late)
            if self.done == self._damaged:
                output[20] ^= 0x10
            self._model.sendall(output)
        return True

    def _sensors(self, step: Step) -> bytes | None:
        """Return the next sensor data, None if no more come."""
        while not self._stream or len(self._stream) < step.length:
            ready = select.select([self._udp, self._model], [], [], self._patience)[0]
            if self._udp in ready:
                self._hear(step)
                continue
            data = self._model.recv(65536) if ready else b''
            if not data:
                return None
            self._stream += data
        end = step.length or len(self._stream)
        data, self._stream = self._stream[:end], self._stream[end:]
        return data

    def _hear(self, step: Step) -> None:
        """Receive a datagram; answer a TIMESYNC by the data recorded after it."""
        data = self._udp.recv(65536)
        self._heard = crc32(data, self._heard)
        if any(message.name == 'TIMESYNC' for message in self._reader.feed(data)):
            self._say(step.early)

    def _say(self, frames: list[str]) -> None:
        for frame in frames:
            self._udp.sendto(bytes.fromhex(frame), self._companion)


class Tap(socket.socket):
    """Socket that notes whether it is the simulator's and has sent the data, and the data."""

    def __init__(self, source: socket.socket, is_model: bool, notes: list) -> None:
        is_blocking = source.getblocking()
        super().__init__(fileno=source.detach())
        self.setblocking(is_blocking)
        self._is_model, self._notes = is_model, notes

    def sendall(self, data: bytes) -> None:
        self._notes.append((self._is_model, True, data))
        super().sendall(data)

    def sendto(self, data: bytes, address: tuple[str, int]) -> int:
        self._notes.append((self._is_model, True, data))
        return super().sendto(data, address)

    def recv(self, size: int) -> bytes:
        return self.recvfrom(size)[0]

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        data, sender = super().recvfrom(size)
        self._notes.append((self._is_model, False, data))
        return data, sender


def tap(firmware: LockstepFirmware) -> list[tuple[bool, bool, bytes]]:
    """Wait for a firmware, and return the notes of all data from now on."""
    notes: list[tuple[bool, bool, bytes]] = []
    line, model = firmware._companion, firmware._simulator
    line._socket = line._source = Tap(line._socket, False, notes)
    if isinstance(firmware, Px4Firmware):
        model._connected(60.0)
    model._line = Tap(model._line, True, notes)
    if isinstance(firmware, ArduPilotFirmware):
        model._receive(60.0)
    return notes


def steps_of(notes: list[tuple[bool, bool, bytes]], count: int) -> tuple[str, list[Step]]:
    """Return what the firmware said first, and steps of `count` answers."""
    first = ''
    if not notes[0][1]:
        first, notes = notes[0][2].hex(), notes[1:]
    steps, is_first = [Step()], True
    for is_model, is_sent, data in notes:
        now = steps[-1]
        if is_sent and len(now.answers) == count:
            now = Step()
            steps.append(now)
        if not is_model and is_sent:
            now.companion = crc32(data, now.companion)
        elif not is_model:
            # The first datagram shows the autopilot's address, whatever it contains.
            frames, is_first = [data] if is_first else known_frames(data), False
            (now.late if now.answers else now.early).extend(frame.hex() for frame in frames)
        elif is_sent:
            now.length = len(data) if count == 1 else 0
            now.sent = crc32(data, now.sent)
            now.answers.append('')
        else:
            now.answers[-1] += data.hex()
    return first, steps


def known_frames(data: bytes) -> Iterator[bytes]:
    """Yield the frames of known messages in a datagram."""
    at = 0
    while at + 12 <= len(data):
        length = 12 + data[at + 1]
        if int.from_bytes(data[at + 7 : at + 10], 'little') in _KNOWN:
            yield data[at : at + length]
        at += length


def record(name: str) -> None:
    """Record the start of the real firmware, and some steps in flight."""
    place = find_px4() if name == PX4 else find_ardupilot()
    if place is None:
        sys.exit(HOW[name])
    with tempfile.TemporaryDirectory() as folder:
        if name == PX4:
            program = Px4Program(place, Path(folder), DRONE, BODY, GAINS, _INSTANCE)
            firmware = Px4Firmware.instance(_INSTANCE)
        else:
            program = ArduPilotProgram(place, Path(folder), DRONE, BODY, _INSTANCE)
            firmware = ArduPilotFirmware.instance(_INSTANCE, DRONE)
        with program:
            notes = tap(firmware)
            fly(flight(firmware))
    first, steps = steps_of(notes, 1 if name == PX4 else 4)
    path = DATA / f'{name}_start.json.gz'
    with gzip.GzipFile(path, 'wb', mtime=0) as file:
        file.write(json.dumps([first, [asdict(step) for step in steps]]).encode())
    print(f'{firmware.problem or "in flight"}, {len(steps)} steps, {path.stat().st_size} bytes')


if __name__ == '__main__':
    record(sys.argv[1])
