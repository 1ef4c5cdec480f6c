import math

import pytest

from aerarm_ros.hardware.frames.frame_profile import FrameField, ProfileError


@pytest.mark.parametrize(
    ('wrong', 'hint'),
    [
        ({'type': 'f32'}, 'type'),
        ({'unit': 'rpm'}, 'unit'),
        ({'motor': 3}, 'motor'),
        ({'overflow': 'wrap'}, 'overflow'),
        ({'lsb': 0.0}, 'lsb'),
        ({'lsb': math.nan}, 'lsb'),
        ({'word': -1}, 'word'),
        ({'type': 'bits', 'bit': 10, 'width': 8}, 'bits 10 to 17'),
        ({'type': 'bits', 'bit': 3, 'width': 0}, 'bits'),
    ],
)
def test_wrong_entries_are_named(wrong, hint):
    with pytest.raises(ProfileError, match=hint):
        FrameField(**{'name': 'velocity', 'word': 1, 'type': 'i16', **wrong})


@pytest.mark.parametrize(
    ('kind', 'lowest', 'highest', 'words'),
    [
        ('u16', 0, 65535, 1),
        ('i16', -32768, 32767, 1),
        ('u32', 0, 2**32 - 1, 2),
        ('i32', -(2**31), 2**31 - 1, 2),
    ],
)
def test_ranges_of_the_types(kind, lowest, highest, words):
    field = FrameField('x', 0, kind)
    assert field.count_range == (lowest, highest)
    assert field.words == words


def test_units_of_the_frames_in_si():
    # spi-protocol: rad = raw/2^24 2 pi; rad/s = raw/2^11 2000 pi/60; raw = Kp 2^11 2 pi;
    # raw = Kd 2^10 2 pi 1000/60.
    position = FrameField('position', 0, 'i32', 2**-24, 'turn')
    velocity = FrameField('velocity', 0, 'i16', 2**-11, 'krpm')
    kp = FrameField('kp', 0, 'u16', 2**-11, 'A/turn')
    kd = FrameField('kd', 0, 'u16', 2**-10, 'A/krpm')
    assert position.si_per_count == pytest.approx(2 * math.pi / 2**24)
    assert velocity.si_per_count == pytest.approx(2000 * math.pi / 60 / 2**11)
    assert 1 / kp.si_per_count == pytest.approx(2**11 * 2 * math.pi)
    assert 1 / kd.si_per_count == pytest.approx(2**10 * 2 * math.pi * 1000 / 60)
