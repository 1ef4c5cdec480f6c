import math

import pytest

from aerarm_ros.hardware.frames.frame_profile import (
    FRAME_BYTES,
    FrameField,
    ProfileError,
    load_profile,
)

MINIMAL = """
name: mine
errors_until_power_cycle: false
command: {{crc_words: {order}, fields: [{command}]}}
sensor: {{crc_words: high_first, fields: [{sensor}]}}
"""


def written(tmp_path, command='', sensor='', order='high_first'):
    path = tmp_path / 'mine.yaml'
    path.write_text(MINIMAL.format(command=command, sensor=sensor, order=order))
    return path


@pytest.mark.parametrize('name', ['uomodri_v3', 'udriver_v2', 'laas_power'])
def test_packaged_profiles_are_complete(name):
    profile = load_profile(name)
    assert profile.name == name
    assert FRAME_BYTES == 34
    for quantity in ('position', 'velocity', 'kp', 'kd', 'current_saturation', 'timeout', 'index'):
        assert profile.command.has(quantity)
    for quantity in ('position', 'velocity', 'current', 'error', 'timestamp', 'index'):
        assert profile.sensor.has(quantity)


def test_own_profile_from_a_file(tmp_path):
    path = written(
        tmp_path, '{name: velocity, motor: 1, word: 2, type: i16, lsb: 2^-3, unit: krpm}'
    )
    (field,) = load_profile(path).command.fields
    assert field.si_per_count == pytest.approx(2000 * math.pi / 60 / 8)


@pytest.mark.parametrize(
    ('command', 'hint'),
    [
        ('{name: speed, word: 1, type: i16}', "no field 'speed'"),
        ('{name: velocity, motor: 1, word: 14, type: i32}', '15 payload words'),
        ('{name: index, word: 15, type: u16}', '15 payload words'),
        ('{name: index, word: 1, type: u16, colour: red}', 'colour'),
        (
            ('{name: index, word: 1, type: u16}, {name: index, word: 1, type: i16}'),
            'use the same bits',
        ),
        ('{name: timeout, word: 1, type: u16}', 'timeout is a physical quantity'),
        ('{name: kp, word: 1, type: u16, lsb: 0.1}', 'kp belongs to each motor'),
        (
            '{name: timeout, motor: 1, word: 1, type: u16, unit: ms}',
            'timeout belongs to the whole board',
        ),
        ('{name: index, word: 1, type: u16, bit: 3}', 'all other types begin at a word'),
        ('{name: index, word: 1, type: u16, nonzero: true}', 'needs a quantity'),
        ('{name: index, word: 1, type: u16, lsb: two}', 'mine'),
        ('{word: 1, type: u16}', 'uomodri_v3.yaml'),
        ('7', 'uomodri_v3.yaml'),
    ],
)
def test_a_wrong_field_is_named(tmp_path, command, hint):
    with pytest.raises(ProfileError, match=hint):
        load_profile(written(tmp_path, command))


def test_wrong_files_are_named(tmp_path):
    with pytest.raises(ProfileError, match='uomodri_v3'):
        load_profile('uomodri_v9')
    with pytest.raises(ProfileError, match=r'nothing\.yaml'):
        load_profile(tmp_path / 'nothing.yaml')
    with pytest.raises(ProfileError, match='crc_words'):
        load_profile(written(tmp_path, order='sideways'))
    for text, hint in (
        ('[1, 2]', 'must be a mapping'),
        ('{', 'cannot be read'),
        ('{name: mine, extends: mine}', 'extends itself'),
        ('{name: mine, extends: nobody}', 'nobody'),
        ('{name: mine, extends: uomodri_v3, command: {fields: [{word: 1}]}}', 'check its fields'),
        ('{name: mine}', 'command'),
    ):
        path = tmp_path / 'bad.yaml'
        path.write_text(text)
        with pytest.raises(ProfileError, match=hint):
            load_profile(path)


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
