"""Simple model of Betaflight's angle mode; also a program with UDP."""

import socket
import struct
import sys
from collections.abc import Sequence

import numpy as np

MIXER = np.array(
    [
        [-0.5, 0.866025, 1.0],
        [-0.5, -0.866025, 1.0],
        [0.5, 0.866025, -1.0],
        [0.5, -0.866025, -1.0],
        [-1.0, 0.0, -1.0],
        [1.0, 0.0, 1.0],
    ]
)
IDLE, LIMIT = 0.055, 40.0
LIMITS = np.array([1.0, 1.0, 0.2])
BOOT = 100  # states after its start in which it does not arm


class ScriptedFirmware:
    """Control loops of a hexarotor: P control of the angle, PI control of the rate."""

    def __init__(self) -> None:
        self.states = 0
        self.is_armed = False
        self.is_deaf = False
        self.sticks: list[int] = []
        self._sum = np.zeros(3)

    def exchange(
        self, channels: Sequence[int], rate: np.ndarray, force: np.ndarray, wxyz: np.ndarray
    ) -> np.ndarray | None:
        self.states += 1
        if self.is_deaf:
            return None
        self.sticks = list(channels)
        roll, pitch, throttle, yaw, arm, angle = channels
        assert angle > 1700
        was_low = not self.is_armed and arm > 1700 and throttle < 1010
        self.is_armed = arm > 1700 and (self.is_armed or (was_low and self.states > BOOT))
        if not self.is_armed:
            self._sum = np.zeros(3)
            return np.full(6, 1000.0)
        w, x, y, z = wxyz
        tilt = np.degrees(
            [
                np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
                np.arcsin(2 * (w * y - z * x)),
            ]
        )
        wanted = np.array([roll - 1500, pitch - 1500]) / 500.0 * LIMIT
        rates = np.append(8.0 * (wanted - tilt), -(yaw - 1500) / 500.0 * 120.0)
        error = rates - np.degrees(rate)
        self._sum = np.clip(self._sum + 0.004 * 8.8 * error, -400.0, 400.0)
        gains = np.array([6.4, 6.4, 1.9])
        turn = np.clip((gains * error + self._sum) / 1000.0, -LIMITS, LIMITS) * [1.0, 1.0, -1.0]
        lift = max(throttle - 1010, 0) / 990.0
        return 1000.0 + 1000.0 * np.clip(IDLE + (1.0 - IDLE) * (lift + MIXER @ turn), IDLE, 1.0)


def main(motor_port: int, state_port: int, rc_port: int) -> None:
    """Answer every state packet, in the layout of a C compiler."""
    states, sticks = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    states.bind(('127.0.0.1', state_port))
    sticks.bind(('127.0.0.1', rc_port))
    firmware = ScriptedFirmware()
    print('ready', flush=True)
    while True:
        numbers = struct.unpack('<18d', states.recv(1024))
        channels = struct.unpack('<d16H', sticks.recv(1024))[1:7]
        rate = np.array(numbers[1:4]) * [1.0, -1.0, -1.0]
        attitude = np.array(numbers[7:11]) * [1.0, 1.0, -1.0, -1.0]
        pulses = firmware.exchange(channels, rate, -np.array(numbers[4:7]), attitude)
        packet = struct.pack('<H2x16f', 6, *pulses, *[0.0] * 10)
        states.sendto(packet, ('127.0.0.1', motor_port))


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
