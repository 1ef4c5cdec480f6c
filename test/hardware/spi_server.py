"""Emulated boards behind the socket of spi_shim.c, in real time or in that of the frames.

Usage: python spi_server.py SOCKET [PACED]

With PACED a millisecond passes with each round of frames, however long the host takes for it, and
none without frames but what a command lets pass: nobody is too late. The encoders are absolute
then: homing turns the joints by the host's time, so a slow host would drive paced ones too fast.

Takes commands as lines of JSON on standard input and answers each with a line:

    {"set": {"device": PATH, ...}}   change attributes of a Device
    {"vanish": PATH}                 the device is gone
    {"come back": PATH}              another device of that name is there
    {"inject": "NAME:BOARD..."}      a fault of an emulated board, see FaultRequest
    {"pass": SECONDS}                time goes on for paced boards, without frames
    {}                               nothing

The answer tells, for each board, what it saw and in what state it is.
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
IDLE = 1e-3  # [s] between two steps of the arm while nobody transfers anything


@dataclass
class Device:
    """One chip select, and what is wrong with its bus."""

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
    """The boards, the sockets of the devices that are open, and the commands."""

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
        if device.connection is None:  # it vanished in the same round
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
        """Advance paced boards, in steps as short as between frames: longer ones would be cut."""
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
                'told_on': board._command.enable_system,  # by the last frame that it took
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
