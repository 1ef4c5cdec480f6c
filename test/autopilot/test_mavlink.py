"""Frames compared with MAVLink's own generator, and a truncated, damaged stream."""

import struct

import pytest

from aerarm_ros.autopilot.mavlink import LAYOUTS, FrameReader, FrameWriter, checksum

# CRC_EXTRA of MAVLink's generated headers (March 2026).
SEEDS = {
    'HEARTBEAT': 50, 'ATTITUDE_QUATERNION': 246, 'LOCAL_POSITION_NED': 185,
    'SERVO_OUTPUT_RAW': 222, 'COMMAND_LONG': 152, 'COMMAND_ACK': 143, 'SET_ATTITUDE_TARGET': 49,
    'SET_POSITION_TARGET_LOCAL_NED': 143, 'HIL_ACTUATOR_CONTROLS': 47, 'HIGHRES_IMU': 93,
    'HIL_SENSOR': 108, 'HIL_GPS': 124, 'TIMESYNC': 34, 'STATUSTEXT': 83, 'ODOMETRY': 91,
    'ACTUATOR_OUTPUT_STATUS': 251, 'SET_GPS_GLOBAL_ORIGIN': 41,
}  # fmt: skip
# A HIL_SENSOR as pymavlink 2.4.50 packs it, sequence 0, system 1, component 2.
GOLDEN = bytes.fromhex(
    'fd3d00000001026b000040e20100000000000000c03f00000000000000000000000000000000000000c000000000000000000000000000000000000000000000000000000000072f78'
)


def test_the_seed_of_every_message_is_that_of_mavlink() -> None:
    assert {name: layout.seed for name, layout in LAYOUTS.items()} == SEEDS


def test_a_frame_is_packed_as_mavlink_packs_it() -> None:
    frame = FrameWriter(1, 2).pack(
        'HIL_SENSOR', time_usec=123456, xacc=1.5, zgyro=-2.0, fields_updated=7
    )
    assert frame == GOLDEN


def test_frames_of_both_versions_come_back() -> None:
    writer, reader = FrameWriter(3, 4), FrameReader()
    [message] = reader.feed(writer.pack('STATUSTEXT', severity=4, text='Arming denied'))
    assert (message.system, message.component, message['text']) == (3, 4, 'Arming denied')
    controls = [0.0625 * i for i in range(16)]
    [message] = reader.feed(writer.pack('HIL_ACTUATOR_CONTROLS', controls=controls, mode=129))
    assert list(message['controls']) == controls
    checked = bytes([9, 7, 1, 1, 0]) + struct.pack('<IBBBBB', 0x60000, 2, 12, 209, 4, 3)
    crc = checksum(checked + bytes([50])).to_bytes(2, 'little')
    [message] = reader.feed(b'\xfe' + checked + crc)
    assert (message['custom_mode'], message['base_mode']) == (0x60000, 209)


def test_a_stream_may_be_cut_anywhere() -> None:
    writer, reader = FrameWriter(1, 1), FrameReader()
    stream = b''.join(writer.pack('HIL_SENSOR', time_usec=i, xacc=float(i)) for i in range(1, 6))
    times = []
    for byte in stream:
        times += [message['time_usec'] for message in reader.feed(bytes([byte]))]
    assert times == [1, 2, 3, 4, 5]
    assert reader.damaged == 0


def test_a_damaged_frame_is_counted_and_those_around_it_are_read() -> None:
    writer = FrameWriter(1, 1)
    frames = [
        writer.pack('HIL_SENSOR', time_usec=i, xacc=1.0, fields_updated=63) for i in (1, 2, 3)
    ]
    for place in range(10, 40):
        damaged, reader = bytearray(frames[1]), FrameReader()
        damaged[place] ^= 0x55
        stream = frames[0] + bytes(damaged) + frames[2] + bytes(300)
        assert [message['time_usec'] for message in reader.feed(stream)] == [1, 3]
        assert reader.damaged >= 1


def test_other_messages_signed_frames_and_noise_are_skipped() -> None:
    unknown = bytes([0xFD, 4, 0, 0, 0, 1, 1, 0x10, 0x27, 0, 1, 2, 3, 4, 9, 9])
    heartbeat = bytearray(FrameWriter(1, 1).pack('HEARTBEAT', type=2))
    heartbeat[2] = 1  # signed: a signature of 13 bytes follows
    heartbeat[-2:] = checksum(bytes(heartbeat[1:-2]) + bytes([50])).to_bytes(2, 'little')
    after = FrameWriter(1, 1).pack('HEARTBEAT', type=3)
    noise = b'\x00NSH> \xfd\x40'
    stream = noise + unknown + bytes(heartbeat) + bytes(range(100, 113)) + after + bytes(300)
    found = FrameReader().feed(stream)
    assert [message['type'] for message in found] == [2, 3]


@pytest.mark.parametrize(
    ('values', 'reason'), [({'no_such': 1}, 'no field no_such'), ({'type': 256}, 'HEARTBEAT')]
)
def test_a_value_that_does_not_fit_is_rejected(values: dict[str, int], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        FrameWriter(1, 1).pack('HEARTBEAT', **values)
