"""Emulated boards behind the socket of spi_shim.c, in real time or in the time of the frames.

Usage: python spi_server.py SOCKET [PACED]

With PACED, each round of frames advances time by a millisecond, however slow the host is. Without
frames only the command `pass` advances time, so no frame is too late. The encoders are then
absolute, because homing moves the joints by the host's time, and a slow host would drive paced
joints too fast.

The program reads commands as lines of JSON on standard input and answers each with a line:

    {"set": {"device": PATH, ...}}   change attributes of a Device
    {"vanish": PATH}                 remove the device
    {"come back": PATH}              add another device of that name
    {"inject": "NAME:BOARD..."}      a fault of an emulated board, see FaultRequest
    {"pass": SECONDS}                advance the time of paced boards, without frames
    {}                               nothing

The answer contains the received data and the state of each board.
"""

import errno
import json
import selectors
import socket
import struct
import sys
import time
from dataclasses import dataclass

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest

NAME_BYTES = 32
HEADER = struct.Struct('=III')
COUNT = struct.Struct('=i')
ROUND = 1e-3  # [s] of paced boards between two frames for one of them
IDLE = 1e-3  # [s] between two steps of the arm without transfers


@dataclass
class Device:
    """One chip select, and the faults of its bus."""

    board: int
    working_mode: int = 0
    eio: bool = False
    length_max: int = 1000
    missing: bool = False
    connection: socket.socket | None = None
    transfers: int = 0
    mode: int = -1
    speed: int = 0


class SpiServer:
    """The boards, the sockets of the open devices, and the commands."""

    def __init__(self, path: str, paced: bool = False) -> None:
        self.paced = paced
        self.time = 0.0  # [s] of paced boards
        config = load_arm_config()
        if paced:
            config = config.with_encoders('absolute')
        self.boards = make_emulated_transport(config, load_robot(), None)
        self.devices = {board.device: Device(i) for i, board in enumerate(config.boards)}
        self.selector = selectors.DefaultSelector()
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(path)
        self.listener.listen()
        self.selector.register(self.listener, selectors.EVENT_READ, self.accept)
        self.selector.register(sys.stdin, selectors.EVENT_READ, self.obey)

    def run(self) -> None:
        self.answer()
        while True:
            for key, _ in self.selector.select(IDLE):
                key.data()
            if not self.paced:
                self.boards.advance(time.monotonic())

    def accept(self) -> None:
        connection, _ = self.listener.accept()
        name = connection.recv(NAME_BYTES, socket.MSG_WAITALL).rstrip(b'\0').decode()
        device = self.devices.get(name)
        if device is None or device.missing:
            connection.sendall(COUNT.pack(errno.ENOENT))
            connection.close()
            return
        connection.sendall(COUNT.pack(0))
        device.connection = connection
        self.selector.register(connection, selectors.EVENT_READ, lambda: self.serve(device))

    def serve(self, device: Device) -> None:
        if device.connection is None:  # removed in this round
            return
        try:
            self.transfer(device)
        except ConnectionError:  # its process was killed
            self.hang_up(device)

    def transfer(self, device: Device) -> None:
        header = device.connection.recv(HEADER.size, socket.MSG_WAITALL)
        if len(header) < HEADER.size:
            self.hang_up(device)
            return
        device.mode, device.speed, length = HEADER.unpack(header)
        frame = device.connection.recv(length, socket.MSG_WAITALL)
        device.transfers += 1
        if self.paced:
            self.let_pass(ROUND / len(self.devices))
        if device.eio:
            device.connection.sendall(COUNT.pack(-errno.EIO))
            return
        if device.mode != device.working_mode:  # every bit is read half a clock late
            answer = self.boards.exchange(device.board, shifted(frame))
            answer = shifted(answer)
        else:
            answer = self.boards.exchange(device.board, frame)
        answer = answer[: device.length_max]
        device.connection.sendall(COUNT.pack(len(answer)) + answer)

    def let_pass(self, seconds: float) -> None:
        """Advance paced boards in steps as between frames, because longer ones would be limited."""
        end = self.time + seconds
        while self.time < end:
            self.time = min(self.time + ROUND, end)
            self.boards.advance(self.time)

    def hang_up(self, device: Device) -> None:
        if device.connection is not None:
            self.selector.unregister(device.connection)
            device.connection.close()
            device.connection = None

    def obey(self) -> None:
        line = sys.stdin.readline()
        if not line:
            sys.exit()
        command = json.loads(line)
        for name, value in command.get('set', {}).items():
            if name != 'device':
                setattr(self.devices[command['set']['device']], name, value)
        if 'vanish' in command:
            device = self.devices[command['vanish']]
            device.missing = True
            self.hang_up(device)
        if 'come back' in command:
            self.devices[command['come back']].missing = False
        if 'inject' in command:
            FaultRequest.parse(command['inject'], len(self.boards.boards)).apply(self.boards)
        if 'pass' in command:
            self.let_pass(command['pass'])
        self.answer()

    def answer(self) -> None:
        report = [
            {
                'transfers': device.transfers,
                'mode': device.mode,
                'speed': device.speed,
                'enabled': board.system_enabled,
                'told_on': board._command.enable_system,  # from the last accepted frame
                'gains': max(*board._command.kp, *board._command.kd),
                'current': max(map(abs, board._command.current)),
                'error': board.error,
            }
            for device, board in zip(self.devices.values(), self.boards.boards, strict=True)
        ]
        print(json.dumps(report), flush=True)


def shifted(frame: bytes) -> bytes:
    return (int.from_bytes(frame) >> 1).to_bytes(len(frame))


if __name__ == '__main__':
    SpiServer(sys.argv[1], paced='PACED' in sys.argv[2:]).run()
