import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec, FrameError
from aerarm_ros.hardware.frames.frame_profile import load_profile

TURN = 2.0 * math.pi
KRPM = 2000.0 * math.pi / 60.0

# The vectors of the protocol's description.
COMMAND_FRAME = bytes.fromhex(
    'f014 00400000 ff800000 0800 f800 0600 ff00 1000 1000 0200 0200 2818 0007 b777 3da4'
)
COMMAND = BoardCommand(
    enable_system=True,
    enable_motor=[True, True],
    timeout=0.020,
    position=[0.25 * TURN, -0.5 * TURN],
    velocity=[KRPM, -KRPM],
    current=[1.5, -0.25],
    kp=[2.0 / TURN, 2.0 / TURN],
    kd=[0.5 / KRPM, 0.5 / KRPM],
    current_saturation=[5.0, 3.0],
    index=7,
)
SENSOR_FRAME = bytes.fromhex(
    'f800 04d2 00200000 ffe00000 0064 ff9c 0200 fe00 0000 0000 0000 0000 0007 3821 ce6b'
)
STATE = BoardState(
    system_enabled=True,
    motor_enabled=[True, True],
    motor_ready=[True, True],
    timestamp=1.234,
    position=[0.125 * TURN, -0.125 * TURN],
    velocity=[100 / 2048 * KRPM, -100 / 2048 * KRPM],
    current=[0.5, -0.5],
    index=7,
)


@pytest.fixture
def codec():
    return FrameCodec(load_profile('uomodri_v3'))


@pytest.fixture(scope='module')
def one_codec():
    """For examples by the hundred."""
    return FrameCodec(load_profile('uomodri_v3'))


def assert_equal(record, expected, names=None):
    for field in dataclasses.fields(expected):
        if names is None or field.name in names:
            value, wanted = getattr(record, field.name), getattr(expected, field.name)
            np.testing.assert_allclose(value, wanted, atol=1e-12, err_msg=field.name)


def test_golden_command(codec):
    assert codec.encode(COMMAND) == COMMAND_FRAME
    assert_equal(codec.decode_command(COMMAND_FRAME), COMMAND)


def test_golden_sensor_frame_with_its_swapped_check(codec):
    assert codec.encode_state(STATE) == SENSOR_FRAME
    assert_equal(codec.decode(SENSOR_FRAME), STATE)


def test_v2_swaps_the_saturation_bytes():
    frame = FrameCodec(load_profile('udriver_v2')).encode(COMMAND)
    assert frame[26:28] == COMMAND_FRAME[27:25:-1]
    assert frame[:26] == COMMAND_FRAME[:26]


def test_laas_power_puts_the_integral_gain_where_the_feed_forward_was():
    command = dataclasses.replace(COMMAND, integral_gain=[1.5 / TURN, 0.25 / TURN])
    frame = FrameCodec(load_profile('laas_power')).encode(command)
    assert frame[14:18] == bytes.fromhex('0600 0100')
    assert frame[:14] == COMMAND_FRAME[:14]


def test_laas_power_reads_voltages():
    codec = FrameCodec(load_profile('laas_power'))
    state = dataclasses.replace(STATE, quadrature_voltage=[3.5, -2.25], bus_voltage=[24.0, 23.5])
    decoded = codec.decode(codec.encode_state(state))
    assert_equal(decoded, state, {'quadrature_voltage', 'bus_voltage', 'current'})


@pytest.mark.parametrize(
    'frame',
    [
        bytes(34),
        b'\xff' * 34,
        b'',
        SENSOR_FRAME[:-1],
        SENSOR_FRAME + b'\x00',
        SENSOR_FRAME[:30] + SENSOR_FRAME[32:] + SENSOR_FRAME[30:32],
        COMMAND_FRAME,
    ],
    ids=['line low', 'line high', 'nothing', 'short', 'long', 'check not swapped', 'echo of ours'],
)
def test_an_invalid_sensor_frame_is_rejected_and_the_record_unchanged(codec, frame):
    state = codec.decode(SENSOR_FRAME)
    assert codec.decode(frame) is None
    assert codec.decode(frame, state) is None
    assert_equal(state, STATE)


def test_decodes_into_a_given_record_and_from_any_bytes(codec):
    state = BoardState()
    assert codec.decode(bytearray(SENSOR_FRAME), state) is state
    assert_equal(state, STATE)
    command = BoardCommand()
    assert codec.decode_command(COMMAND_FRAME, command) is command
    assert_equal(command, COMMAND)


def within(bound):
    return st.lists(st.floats(-bound, bound), min_size=2, max_size=2)


FLAGS = st.lists(st.booleans(), min_size=2, max_size=2)


@given(
    st.builds(
        BoardCommand,
        enable_system=st.booleans(),
        enable_motor=FLAGS,
        index_offset_compensation=FLAGS,
        position_rollover_error=st.booleans(),
        timeout=st.floats(0.001, 0.255),
        position=within(127.9 * TURN),
        velocity=within(15.9 * KRPM),
        current=within(31.9),
        kp=st.lists(st.floats(0, 5.09), min_size=2, max_size=2),
        kd=st.lists(st.floats(0, 0.61), min_size=2, max_size=2),
        current_saturation=st.lists(st.floats(0.125, 31.8), min_size=2, max_size=2),
        index=st.integers(0, 65535),
    )
)
def test_commands_come_back_to_half_a_count(one_codec, command):
    decoded = one_codec.decode_command(one_codec.encode(command))
    half_counts = {
        'timeout': 0.5e-3,
        'position': TURN / 2**25,
        'velocity': KRPM / 2**12,
        'current': 2**-11,
        'kp': 2**-12 / TURN,
        'kd': 2**-11 / KRPM,
        'current_saturation': 2**-4,
    }
    for name, tolerance in half_counts.items():
        wanted = pytest.approx(getattr(command, name), abs=tolerance * 1.0001)
        assert getattr(decoded, name) == wanted, name
    names = {'enable_system', 'enable_motor', 'index_offset_compensation', 'index'}
    assert_equal(decoded, command, names)


@given(
    st.builds(
        BoardState,
        system_enabled=st.booleans(),
        motor_enabled=FLAGS,
        motor_ready=FLAGS,
        index_detected=FLAGS,
        index_toggle=FLAGS,
        error=st.integers(0, 15),
        index=st.integers(0, 65535),
        position=within(1e4),
        velocity=within(1e4),
        current=within(100.0),
    )
)
def test_states_survive_two_passes(one_codec, state):
    frame = one_codec.encode_state(state)
    decoded = one_codec.decode(frame)
    assert one_codec.encode_state(decoded) == frame
    assert decoded.error == state.error
    assert decoded.motor_ready == state.motor_ready


def encoded_and_read(codec, **values):
    return codec.decode_command(codec.encode(BoardCommand(**values)))


def test_harmless_values_saturate_and_never_wrap(codec):
    read = encoded_and_read(
        codec,
        velocity=[1e6, -1e6],
        current=[1e3, -1e3],
        kp=[1e3, -1.0],
        kd=[1e3, -1.0],
        current_saturation=[1e3, 40.0],
        timeout=10.0,
        index=65536 + 5,
    )
    assert read.index == 5
    assert read.velocity == pytest.approx([16 * KRPM, -16 * KRPM], rel=1e-4)
    assert read.current == pytest.approx([32.0, -32.0], rel=1e-4)
    assert read.kp == pytest.approx([5.09, 0.0], abs=0.01)
    assert read.kd == pytest.approx([0.611, 0.0], abs=0.001)
    assert read.current_saturation == [31.875, 31.875]
    assert read.timeout == pytest.approx(0.255)


@pytest.mark.parametrize(
    ('values', 'hint'),
    [
        (
            {'position': [128.1 * TURN, 0.0]},
            r'position of motor 1 is 804\.876, outside the range \+-804\.248 of the frame: check '
            'the reference and the zero of the encoder$',
        ),
        ({'position': [0.0, -128.1 * TURN]}, 'position of motor 2 .* outside the range'),
        ({'position': [math.nan, 0.0]}, 'position of motor 1 is nan'),
        ({'velocity': [0.0, math.inf]}, 'velocity of motor 2 is inf'),
        ({'current': [math.nan, 0.0]}, 'current of motor 1'),
        (
            {'timeout': 0.0},
            'timeout is 0, which the frame rounds to 0 and the board reads as "no limit": '
            r'set 0\.001 or more$',
        ),
        ({'timeout': 0.0004}, 'timeout'),
        ({'timeout': -0.02}, 'timeout is -0.02'),
        ({'timeout': -math.inf}, 'timeout is -inf'),
        ({'current_saturation': [0.0, 1.0]}, 'current_saturation of motor 1'),
        ({'current_saturation': [1.0, 0.05]}, 'current_saturation of motor 2'),
        ({'current_saturation': [-5.0, 1.0]}, 'current_saturation of motor 1 is -5'),
        ({'current_saturation': [1.0, -1e9]}, 'current_saturation of motor 2 is -1e'),
        ({'current_saturation': [1.0, math.nan]}, 'current_saturation of motor 2'),
    ],
)
def test_dangerous_values_are_rejected(codec, values, hint):
    with pytest.raises(FrameError, match=hint):
        codec.encode(BoardCommand(**values))


def test_only_values_in_range_are_packed_fast(codec):
    current = next(f for f in load_profile().command.fields if (f.name, f.motor) == ('current', 1))
    lowest, highest = current.count_range
    for count in (lowest - 1, lowest, highest, highest + 1):
        command = BoardCommand(current=[count * current.si_per_count, 0.0])
        is_packed = codec.command._pack(command) is not None
        assert is_packed == (lowest <= count <= highest)


@pytest.mark.parametrize('profile', ['uomodri_v3', 'laas_power'])
def test_values_in_range_use_the_fast_path(profile, monkeypatch):
    codec = FrameCodec(load_profile(profile))
    for direction in (codec.command, codec.sensor):
        monkeypatch.setattr(direction, '_pack_limited', None)
    codec.encode(BoardCommand(position=[-3.0, 3.0], velocity=[-4.0, 4.0], current=[-1.0, 1.0]))
    codec.encode_state(BoardState(position=[-3.0, 3.0], velocity=[-4.0, 4.0], current=[-1.0, 1.0]))
