"""Packets compared with bytes, and a scripted firmware as a process."""

import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scripted_firmware import BOOT

from aerarm_ros.autopilot.betaflight_link import (
    BetaflightLink,
    motor_outputs,
    rc_packet,
    state_packet,
)

SCRIPT = Path(__file__).with_name('scripted_firmware.py')
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
COMPILED = """
#include <stdio.h>
#include <stddef.h>
#include <stdint.h>
typedef struct { double timestamp, rate[3], acceleration[3], attitude[4], velocity[3], position[3],
    pressure; } fdm_packet;
typedef struct { double timestamp; uint16_t channels[16]; } rc_packet;
typedef struct { uint16_t motorCount; float pwm_output_raw[16]; } servo_packet_raw;
int main(void) {
    printf("%zu %zu %zu %zu %zu", sizeof(fdm_packet), offsetof(fdm_packet, attitude),
        sizeof(rc_packet), sizeof(servo_packet_raw), offsetof(servo_packet_raw, pwm_output_raw));
}
"""


def test_packets_are_those_of_the_firmware_byte_by_byte() -> None:
    state = state_packet(1.5, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 9.8]), np.full(4, 0.5))
    expected = [1.5, 1.0, -2.0, -3.0, -0.1, -0.2, -9.8, 0.5, 0.5, -0.5, -0.5, *[0.0] * 6, 101325.0]
    assert state == b''.join(struct.pack('<d', number) for number in expected)
    sticks = rc_packet(2.0, [1500, 1501, 1000])
    assert sticks[:14] == bytes.fromhex('0000000000000040dc05dd05e803')
    assert len(sticks) == 40
    assert sticks[14:] == 13 * bytes.fromhex('e803')
    packet = bytes.fromhex('06000000') + struct.pack('<16f', *range(1000, 1016))
    np.testing.assert_array_equal(motor_outputs(packet), np.arange(1000, 1006))


@pytest.mark.parametrize(
    'packet',
    [
        b'',
        bytes(67),
        bytes(68),
        struct.pack('<H2x16f', 17, *[1.0] * 16),
        struct.pack('<H2x16f', 6, *[float('nan')] * 16),
    ],
)
def test_what_is_no_packet_of_motors_is_none(packet: bytes) -> None:
    assert motor_outputs(packet) is None


@pytest.mark.skipif(shutil.which('cc') is None, reason='no C compiler')
def test_a_compiler_lays_them_out_so(tmp_path: Path) -> None:
    source = tmp_path / 'layout.c'
    source.write_text(COMPILED)
    subprocess.run(['cc', '-o', tmp_path / 'layout', source], check=True)
    sizes = subprocess.run([tmp_path / 'layout'], check=True, capture_output=True, text=True).stdout
    assert [int(size) for size in sizes.split()] == [144, 56, 40, 68, 4]


def free_ports() -> list[int]:
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    for each in sockets:
        each.bind(('127.0.0.1', 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


@pytest.fixture
def link() -> Iterator[BetaflightLink]:
    ports = free_ports()
    process = subprocess.Popen(
        [sys.executable, SCRIPT, *map(str, ports)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == 'ready\n'
    link = BetaflightLink(*ports)
    yield link
    link.close()
    process.kill()
    process.wait()


def test_a_firmware_beside_us_is_armed_and_answers(link: BetaflightLink) -> None:
    hover, level = [1500, 1500, 1400, 1500, 2000, 2000], np.array([0.0, 0.0, 9.81])
    heard = []
    for _ in range(20000):
        low = [1500, 1500, 1000, 1500, 2000, 2000]
        pulses = link.exchange(
            low if len(heard) < BOOT + 20 else hover, np.zeros(3), level, UPRIGHT
        )
        if pulses is not None:
            heard.append(pulses)
        if len(heard) > BOOT + 100:
            break
    assert np.all(heard[0] == 1000.0)
    np.testing.assert_allclose(heard[-1], 1055.0 + 945.0 * 390.0 / 990.0, rtol=1e-6)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('127.0.0.1', 0))
        port = other.getsockname()[1]
        with pytest.raises(ValueError, match=f'UDP port {port} .*stop the other'):
            BetaflightLink(port)
