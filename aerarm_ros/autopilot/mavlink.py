"""Encoding and decoding of the MAVLink messages that this package uses.

The table lists fields in the form of MAVLink's XML definitions (common.xml, minimal.xml, read in
March 2026). The protocol's rules determine the order on the wire (larger types first, extensions
last) and the checksum seed; see https://mavlink.io/en/guide/serialization.html.
"""

import re
import struct
from binascii import crc_hqx
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_DEFINITIONS = """
0 HEARTBEAT: uint8_t type, uint8_t autopilot, uint8_t base_mode, uint32_t custom_mode, uint8_t
    system_status, uint8_t mavlink_version
31 ATTITUDE_QUATERNION: uint32_t time_boot_ms, float q1, float q2, float q3, float q4, float
    rollspeed, float pitchspeed, float yawspeed; float[4] repr_offset_q
32 LOCAL_POSITION_NED: uint32_t time_boot_ms, float x, float y, float z, float vx, float vy, float
    vz
36 SERVO_OUTPUT_RAW: uint32_t time_usec, uint8_t port, uint16_t servo1_raw, uint16_t servo2_raw,
    uint16_t servo3_raw, uint16_t servo4_raw, uint16_t servo5_raw, uint16_t servo6_raw, uint16_t
    servo7_raw, uint16_t servo8_raw; uint16_t servo9_raw, uint16_t servo10_raw, uint16_t
    servo11_raw, uint16_t servo12_raw, uint16_t servo13_raw, uint16_t servo14_raw, uint16_t
    servo15_raw, uint16_t servo16_raw
48 SET_GPS_GLOBAL_ORIGIN: uint8_t target_system, int32_t latitude, int32_t longitude, int32_t
    altitude; uint64_t time_usec
76 COMMAND_LONG: uint8_t target_system, uint8_t target_component, uint16_t command, uint8_t
    confirmation, float param1, float param2, float param3, float param4, float param5, float
    param6, float param7
77 COMMAND_ACK: uint16_t command, uint8_t result; uint8_t progress, int32_t result_param2, uint8_t
    target_system, uint8_t target_component
82 SET_ATTITUDE_TARGET: uint32_t time_boot_ms, uint8_t target_system, uint8_t target_component,
    uint8_t type_mask, float[4] q, float body_roll_rate, float body_pitch_rate, float
    body_yaw_rate, float thrust; float[3] thrust_body
84 SET_POSITION_TARGET_LOCAL_NED: uint32_t time_boot_ms, uint8_t target_system, uint8_t
    target_component, uint8_t coordinate_frame, uint16_t type_mask, float x, float y, float z,
    float vx, float vy, float vz, float afx, float afy, float afz, float yaw, float yaw_rate
93 HIL_ACTUATOR_CONTROLS: uint64_t time_usec, float[16] controls, uint8_t mode, uint64_t flags
105 HIGHRES_IMU: uint64_t time_usec, float xacc, float yacc, float zacc, float xgyro, float ygyro,
    float zgyro, float xmag, float ymag, float zmag, float abs_pressure, float diff_pressure, float
    pressure_alt, float temperature, uint16_t fields_updated; uint8_t id
107 HIL_SENSOR: uint64_t time_usec, float xacc, float yacc, float zacc, float xgyro, float ygyro,
    float zgyro, float xmag, float ymag, float zmag, float abs_pressure, float diff_pressure, float
    pressure_alt, float temperature, uint32_t fields_updated; uint8_t id
113 HIL_GPS: uint64_t time_usec, uint8_t fix_type, int32_t lat, int32_t lon, int32_t alt, uint16_t
    eph, uint16_t epv, uint16_t vel, int16_t vn, int16_t ve, int16_t vd, uint16_t cog, uint8_t
    satellites_visible; uint8_t id, uint16_t yaw
111 TIMESYNC: int64_t tc1, int64_t ts1; uint8_t target_system, uint8_t target_component
253 STATUSTEXT: uint8_t severity, char[50] text; uint16_t id, uint8_t chunk_seq
331 ODOMETRY: uint64_t time_usec, uint8_t frame_id, uint8_t child_frame_id, float x, float y, float
    z, float[4] q, float vx, float vy, float vz, float rollspeed, float pitchspeed, float yawspeed,
    float[21] pose_covariance, float[21] velocity_covariance; uint8_t reset_counter, uint8_t
    estimator_type, int8_t quality
375 ACTUATOR_OUTPUT_STATUS: uint64_t time_usec, uint32_t active, float[32] actuator
"""
_CODES = {
    'uint64_t': 'Q', 'uint32_t': 'I', 'uint16_t': 'H', 'uint8_t': 'B',
    'int64_t': 'q',
    'int32_t': 'i', 'int16_t': 'h', 'int8_t': 'b', 'float': 'f', 'char': 's',
}  # fmt: skip
_TURNED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))
_START_1, _START_2 = 0xFE, 0xFD
_HEAD_1, _HEAD_2, _CRC, _SIGNATURE = 6, 10, 2, 13
_SIGNED = 0x01


def checksum(data: bytes) -> int:
    """Return the checksum that MAVLink uses for bytes, a CRC-16/MCRF4XX."""
    turned = crc_hqx(data.translate(_TURNED), 0xFFFF)
    return _TURNED[turned >> 8] | _TURNED[turned & 0xFF] << 8


@dataclass(frozen=True)
class _Field:
    name: str
    code: str
    count: int

    @property
    def size(self) -> int:
        return 1 if self.code == 's' else struct.calcsize('<' + self.code)

    @property
    def format(self) -> str:
        return f'{self.count}{self.code}' if self.count > 1 else self.code


class MessageLayout:
    """Layout of a MAVLink message: the position of each field in its payload.

    Parameters
    ----------
    number : int
        Message id.
    base, extensions : str
        Types and names of the message's fields, as in its XML definition.
    """

    def __init__(self, number: int, name: str, base: str, extensions: str) -> None:
        self.number, self.name = number, name
        seed = name + ' '
        fields = []
        for kind, length, field in sorted(_declared(base), key=_size, reverse=True):
            seed += f'{kind} {field} ' + (chr(length) if length else '')
            fields.append(_Field(field, _CODES[kind], max(length, 1)))
        turned = checksum(seed.encode('latin1'))
        self.seed = turned & 0xFF ^ turned >> 8
        self.base_size = struct.calcsize('<' + ''.join(field.format for field in fields))
        fields += [_Field(x, _CODES[kind], max(n, 1)) for kind, n, x in _declared(extensions)]
        self._fields = fields
        self._struct = struct.Struct('<' + ''.join(field.format for field in fields))
        self._names = {field.name for field in fields}

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Encode field values as payload without trailing zeros; missing fields are 0.

        Raises
        ------
        ValueError
            If a field is unknown, or a value does not fit its field.
        """
        if unknown := values.keys() - self._names:
            raise ValueError(f'MAVLink {self.name} has no field {sorted(unknown)[0]}')
        flat: list[Any] = []
        for field in self._fields:
            value = values.get(field.name, 0)
            if field.code == 's':
                flat.append(str(value or '').encode())
            elif field.count > 1:
                flat += [0] * field.count if field.name not in values else list(value)
            else:
                flat.append(value)
        try:
            payload = self._struct.pack(*flat)
        except struct.error as error:
            raise ValueError(f'MAVLink {self.name}: {error}') from None
        return payload.rstrip(b'\0') or b'\0'

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Decode the field values of a payload; missing bytes at its end count as zeros."""
        size = self._struct.size
        flat = self._struct.unpack(payload[:size].ljust(size, b'\0'))
        values: dict[str, Any] = {}
        at = 0
        for field in self._fields:
            if field.code == 's':
                values[field.name] = flat[at].split(b'\0')[0].decode(errors='replace')
                at += 1
            elif field.count > 1:
                values[field.name] = flat[at : at + field.count]
                at += field.count
            else:
                values[field.name] = flat[at]
                at += 1
        return values


def _declared(text: str) -> list[tuple[str, int, str]]:
    """Return type, array length (0 for a scalar) and name of each field in a definition."""
    found = re.findall(r'(\w+)(?:\[(\d+)\])? (\w+)', text)
    return [(kind, int(length or 0), name) for kind, length, name in found]


def _size(declared: tuple[str, int, str]) -> int:
    return _Field(declared[2], _CODES[declared[0]], 1).size


def _layouts() -> dict[str, MessageLayout]:
    found = {}
    for line in re.sub(r'\n +', ' ', _DEFINITIONS).strip().splitlines():
        head, fields = line.split(': ')
        number, name = head.split()
        base, _, extensions = fields.partition(';')
        found[name] = MessageLayout(int(number), name, base, extensions)
    return found


LAYOUTS = _layouts()
_BY_NUMBER = {layout.number: layout for layout in LAYOUTS.values()}


@dataclass(frozen=True)
class Message:
    """MAVLink message that was received.

    Attributes
    ----------
    system, component : int
        MAVLink ids of the message's sender.
    values : dict
        Values of the message's fields, by name.
    """

    name: str
    system: int
    component: int
    values: dict[str, Any]

    def __getitem__(self, field: str) -> Any:
        """Return the value of a field of the message."""
        return self.values[field]


class FrameWriter:
    """Encodes messages of one sender as unsigned MAVLink 2 frames.

    Parameters
    ----------
    system, component : int
        MAVLink ids of the sender.
    """

    def __init__(self, system: int, component: int) -> None:
        self._sender = system, component
        self._sequence = 0

    def pack(self, name: str, **values: Any) -> bytes:
        """Encode a message as frame; raise ValueError if a value does not fit its field."""
        layout = LAYOUTS[name]
        payload = layout.pack(values)
        number = layout.number.to_bytes(3, 'little')
        head = bytes([len(payload), 0, 0, self._sequence, *self._sender]) + number
        self._sequence = (self._sequence + 1) % 256
        checked = head + payload
        crc = checksum(checked + bytes([layout.seed]))
        return bytes([_START_2]) + checked + crc.to_bytes(2, 'little')


class FrameReader:
    """Decodes the messages listed in `LAYOUTS` from a byte stream of MAVLink 1 or MAVLink 2.

    Other messages are skipped, and so are bytes outside frames, for example after a loss.

    Attributes
    ----------
    damaged : int
        Number of frames of known messages with a wrong checksum.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.damaged = 0

    def feed(self, data: bytes) -> list[Message]:
        """Process received bytes; return the messages that these bytes complete."""
        buffer = self._bytes
        buffer += data
        found: list[Message] = []
        at = 0
        while (at := _next_start(buffer, at)) < len(buffer):
            length = _frame_length(buffer, at)
            if length is None or at + length > len(buffer):
                break
            message = self._message(bytes(buffer[at : at + length]))
            if message is None:
                at += 1  # a frame may begin within a false frame
                continue
            found += message
            at += length
        del buffer[:at]
        return found

    def _message(self, frame: bytes) -> list[Message] | None:
        """Decode a frame; return [] for an unknown message, None for a wrong checksum."""
        if frame[0] == _START_2:
            head, number = _HEAD_2, int.from_bytes(frame[7:10], 'little')
            system, component = frame[5:7]
        else:
            head, number = _HEAD_1, frame[5]
            system, component = frame[3:5]
        layout = _BY_NUMBER.get(number)
        if layout is None:
            return []
        end = head + frame[1]
        given = int.from_bytes(frame[end : end + _CRC], 'little')
        if checksum(frame[1:end] + bytes([layout.seed])) != given:
            self.damaged += 1
            return None
        return [Message(layout.name, system, component, layout.unpack(frame[head:end]))]


def _next_start(buffer: bytearray, at: int) -> int:
    """Return the index of the next possible frame start, or the length of the buffer."""
    while at < len(buffer):
        flags = buffer[at + 2 : at + 3]
        if buffer[at] == _START_1 or (buffer[at] == _START_2 and flags <= bytes([_SIGNED])):
            return at
        at += 1
    return at


def _frame_length(buffer: bytearray, at: int) -> int | None:
    """Return the length of the frame at an index, None if too few bytes have arrived."""
    if len(buffer) < at + 3:
        return None
    if buffer[at] == _START_1:
        return _HEAD_1 + buffer[at + 1] + _CRC
    return _HEAD_2 + buffer[at + 1] + _CRC + _SIGNATURE * (buffer[at + 2] & _SIGNED)
