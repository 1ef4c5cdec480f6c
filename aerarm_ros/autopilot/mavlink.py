"""Encoding and decoding of the MAVLink messages that this package uses.

The table lists the types and names of fields in the order of MAVLink's XML definitions
(common.xml, minimal.xml, read in March 2026). The protocol's rules determine the order on the wire
(larger types first, extensions last) and the checksum seed; see
https://mavlink.io/en/guide/serialization.html.
"""

import re
import struct
from binascii import crc_hqx
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

# Number and name of a message, and its fields; extensions follow after a semicolon.
_DEFINITIONS = """
0 HEARTBEAT: uint8_t type autopilot base_mode, uint32_t custom_mode, uint8_t system_status
    mavlink_version
31 ATTITUDE_QUATERNION: uint32_t time_boot_ms, float q1 q2 q3 q4 rollspeed pitchspeed yawspeed;
    float[4] repr_offset_q
32 LOCAL_POSITION_NED: uint32_t time_boot_ms, float x y z vx vy vz
36 SERVO_OUTPUT_RAW: uint32_t time_usec, uint8_t port, uint16_t servo1_raw servo2_raw servo3_raw
    servo4_raw servo5_raw servo6_raw servo7_raw servo8_raw; uint16_t servo9_raw servo10_raw
    servo11_raw servo12_raw servo13_raw servo14_raw servo15_raw servo16_raw
48 SET_GPS_GLOBAL_ORIGIN: uint8_t target_system, int32_t latitude longitude altitude; uint64_t
    time_usec
76 COMMAND_LONG: uint8_t target_system target_component, uint16_t command, uint8_t confirmation,
    float param1 param2 param3 param4 param5 param6 param7
77 COMMAND_ACK: uint16_t command, uint8_t result; uint8_t progress, int32_t result_param2, uint8_t
    target_system target_component
82 SET_ATTITUDE_TARGET: uint32_t time_boot_ms, uint8_t target_system target_component type_mask,
    float[4] q, float body_roll_rate body_pitch_rate body_yaw_rate thrust; float[3] thrust_body
84 SET_POSITION_TARGET_LOCAL_NED: uint32_t time_boot_ms, uint8_t target_system target_component
    coordinate_frame, uint16_t type_mask, float x y z vx vy vz afx afy afz yaw yaw_rate
93 HIL_ACTUATOR_CONTROLS: uint64_t time_usec, float[16] controls, uint8_t mode, uint64_t flags
105 HIGHRES_IMU: uint64_t time_usec, float xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag
    abs_pressure diff_pressure pressure_alt temperature, uint16_t fields_updated; uint8_t id
107 HIL_SENSOR: uint64_t time_usec, float xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag
    abs_pressure diff_pressure pressure_alt temperature, uint32_t fields_updated; uint8_t id
113 HIL_GPS: uint64_t time_usec, uint8_t fix_type, int32_t lat lon alt, uint16_t eph epv vel,
    int16_t vn ve vd, uint16_t cog, uint8_t satellites_visible; uint8_t id, uint16_t yaw
111 TIMESYNC: int64_t tc1 ts1; uint8_t target_system target_component
253 STATUSTEXT: uint8_t severity, char[50] text; uint16_t id, uint8_t chunk_seq
331 ODOMETRY: uint64_t time_usec, uint8_t frame_id child_frame_id, float x y z, float[4] q, float vx
    vy vz rollspeed pitchspeed yawspeed, float[21] pose_covariance velocity_covariance; uint8_t
    reset_counter estimator_type, int8_t quality
375 ACTUATOR_OUTPUT_STATUS: uint64_t time_usec, uint32_t active, float[32] actuator
"""
_CODES = {
    'uint64_t': 'Q', 'uint32_t': 'I', 'uint16_t': 'H', 'uint8_t': 'B', 'int64_t': 'q',
    'int32_t': 'i', 'int16_t': 'h', 'int8_t': 'b', 'float': 'f', 'char': 's',
}  # fmt: skip
_TURNED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))
_START_1, _START_2 = 0xFE, 0xFD
# A start byte, for MAVLink 2 with flags (signed or not) that may not have arrived yet.
_START = re.compile(rb'\xfe|\xfd(?:.[\x00\x01]|.?\Z)', re.DOTALL)
_HEAD_1, _HEAD_2, _CRC, _SIGNATURE = 6, 10, 2, 13


def checksum(data: bytes) -> int:
    """Return the checksum that MAVLink uses for bytes, a CRC-16/MCRF4XX."""
    turned = crc_hqx(data.translate(_TURNED), 0xFFFF)
    return _TURNED[turned >> 8] | _TURNED[turned & 0xFF] << 8


class _Field(NamedTuple):
    name: str
    kind: str
    length: int  # 0 for a scalar

    @property
    def size(self) -> int:
        return struct.calcsize('<' + _CODES[self.kind])


def _fields(text: str) -> list[_Field]:
    """Return the fields of a definition, in which a type stands before one or several names."""
    found = re.findall(r'(\w+)(?:\[(\d+)\])? ([\w ]+)', text)
    return [
        _Field(name, kind, int(count or 0))
        for kind, count, names in found
        for name in names.split()
    ]


class MessageLayout:
    """Layout of a MAVLink message: the position of each field in its payload.

    Parameters
    ----------
    number : int
        Message id.
    base, extensions : str
        Types and names of the message's fields, as in `_DEFINITIONS`.
    """

    def __init__(self, number: int, name: str, base: str, extensions: str) -> None:
        self.number, self.name = number, name
        ordered = sorted(_fields(base), key=lambda field: field.size, reverse=True)
        texts = [f'{x.kind} {x.name} ' + (chr(x.length) if x.length else '') for x in ordered]
        turned = checksum(''.join([name, ' ', *texts]).encode('latin1'))
        self.seed = turned & 0xFF ^ turned >> 8
        self._fields = [*ordered, *_fields(extensions)]
        codes = [f'{field.length or ""}{_CODES[field.kind]}' for field in self._fields]
        self._struct = struct.Struct('<' + ''.join(codes))

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Encode field values as payload without trailing zeros; missing fields are 0.

        Raises
        ------
        ValueError
            If a field is unknown, or a value does not fit its field.
        """
        if unknown := values.keys() - {field.name for field in self._fields}:
            raise ValueError(f'MAVLink {self.name} has no field {sorted(unknown)[0]}')
        flat: list[Any] = []
        for name, kind, length in self._fields:
            if kind == 'char':
                flat.append(str(values.get(name, '')).encode())
            elif length:
                flat += values.get(name, [0] * length)
            else:
                flat.append(values.get(name, 0))
        try:
            payload = self._struct.pack(*flat)
        except struct.error as error:
            raise ValueError(f'MAVLink {self.name}: {error}') from None
        return payload.rstrip(b'\0') or b'\0'

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Decode the field values of a payload; missing bytes at its end count as zeros."""
        size = self._struct.size
        flat = iter(self._struct.unpack(payload[:size].ljust(size, b'\0')))
        values: dict[str, Any] = {}
        for name, kind, length in self._fields:
            if kind == 'char':
                values[name] = next(flat).split(b'\0')[0].decode(errors='replace')
            else:
                values[name] = tuple(islice(flat, length)) if length else next(flat)
        return values


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
        head = bytes([len(payload), 0, 0, self._sequence, *self._sender])
        self._sequence = (self._sequence + 1) % 256
        checked = head + layout.number.to_bytes(3, 'little') + payload
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
        while (start := _START.search(buffer, at)) is not None:
            at = start.start()
            length = _frame_length(buffer, at)
            if length is None or at + length > len(buffer):
                break
            message = self._message(bytes(buffer[at : at + length]))
            if message is None:
                at += 1  # a frame may begin within a false frame
                continue
            found += message
            at += length
        else:
            at = len(buffer)
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


def _frame_length(buffer: bytearray, at: int) -> int | None:
    """Return the length of the frame at an index, None if too few bytes have arrived."""
    if len(buffer) < at + 3:
        return None
    if buffer[at] == _START_1:
        return _HEAD_1 + buffer[at + 1] + _CRC
    return _HEAD_2 + buffer[at + 1] + _CRC + _SIGNATURE * (buffer[at + 2] & 1)
