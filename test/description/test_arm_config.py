"""Reading the arm's YAML: valid values are kept, errors are named."""

from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.resources import resource

Document = dict[str, Any]
Change = Callable[[Document], object]


@pytest.fixture
def write(tmp_path: Path) -> Callable[[Change], Path]:
    """Return a function that writes the packaged YAML with a change."""

    def write(change: Change) -> Path:
        document = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
        change(document)
        path = tmp_path / 'arm.yaml'
        path.write_text(yaml.safe_dump(document))
        return path

    return write


def setting(*keys: str | int, value: object) -> Change:
    """Return a change that sets one entry, however deep."""

    def change(document: Document) -> None:
        place: Any = document
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    return change


def removing(*keys: str | int) -> Change:
    def change(document: Document) -> None:
        place: Any = document
        for key in keys[:-1]:
            place = place[key]
        del place[keys[-1]]

    return change


WRONG = {
    'unknown key': (setting('speed', value=1), 'unknown key speed'),
    'unknown joint key': (
        setting('joints', 1, 'limit', value=1),
        r'joints\[1\] has the unknown key limit',
    ),
    'missing key': (removing('joints', 2, 'offset'), r'joints\[2\] lacks the key offset'),
    'no resistance': (
        removing('motors', 'MN4006', 'resistance'),
        r'motors\.MN4006 lacks the key resistance',
    ),
    'missing section': (removing('boards'), 'lacks the key boards'),
    'empty section': (setting('joints', value=[]), 'joints must be a non-empty list'),
    'section of wrong kind': (setting('motors', value=[1]), 'motors must be a non-empty mapping'),
    'entry of wrong kind': (setting('boards', 0, value='spi'), r'boards\[0\] must be a mapping'),
    'joint of wrong kind': (setting('joints', 0, value=7), r'joints\[0\] must be a mapping'),
    'text for a number': (setting('joints', 0, 'coulomb', value='x'), 'coulomb must be a number'),
    'truth for a number': (setting('joints', 0, 'coulomb', value=True), 'must be a number'),
    'coupling of an unknown joint': (
        setting('coupled_joints', value=[['joint3', 'elbow']]),
        'joint3 and elbow must be two different joints',
    ),
    'coupling without a driver': (
        setting('coupled_joints', value=['joint3']),
        r"'joint3' must be a pair \[joint, driver\]",
    ),
    'NaN': (setting('joints', 0, 'viscous', value=float('nan')), 'joint1: viscous = nan'),
    'infinity': (setting('joints', 0, 'velocity_max', value=float('inf')), 'velocity_max = inf'),
    'negative friction': (setting('joints', 0, 'coulomb', value=-0.1), 'coulomb = -0.1'),
    'degrees': (setting('joints', 0, 'position_max', value=170), r'position_max = 170.*\[rad\]'),
    'limits crossed': (setting('joints', 3, 'position_min', value=2.5), 'below'),
    'gear upside down': (setting('gears', 'cycloidal', 'ratio', value=31), 'cycloidal: ratio'),
    'efficiency in percent': (
        setting('gears', 'cycloidal', 'efficiency', value=90),
        'efficiency = 90',
    ),
    'inertia in g cm^2': (
        setting('motors', 'MN4004', 'rotor_inertia', value=100.0),
        r'MN4004: rotor_inertia.*\[kg m\^2\]',
    ),
    'more torque than the motor has': (
        setting('joints', 0, 'effort_max', value=40.0),
        'effort_max = 40.0 Nm exceeds the .* Nm of motor MN5006',
    ),
    'sign': (setting('joints', 0, 'sign', value=0), 'sign = 0 must be one of 1, -1'),
    'channel': (setting('joints', 0, 'channel', value=2), 'channel = 2 must be one of 0, 1'),
    'fractional board': (setting('joints', 0, 'board', value=0.5), 'board must be a whole number'),
    'board that is not there': (setting('joints', 3, 'board', value=2), 'joint4: board = 2'),
    'shared channel': (
        setting('joints', 3, 'channel', value=0),
        'joint4: board 1, channel 0 is already used by joint joint3',
    ),
    'shared device': (
        setting('boards', 1, 'device', value='/dev/spidev0.0'),
        "device '/dev/spidev0.0' occurs twice",
    ),
    'repeated joint': (setting('joints', 1, 'name', value='joint1'), "'joint1' occurs twice"),
    'no name': (setting('joints', 1, 'name', value=''), 'name'),
    'unknown motor': (
        setting('joints', 0, 'motor', value='MN1'),
        r"joints\[0\]: motor = 'MN1' must be one of the motors MN",
    ),
    'unknown gear': (setting('joints', 0, 'gear', value=['x']), 'must be one of the gears'),
    'SPI mode': (setting('boards', 0, 'mode', value=4), 'board0: mode = 4'),
    'SPI clock in MHz': (setting('boards', 0, 'clock_hz', value=8), r'clock_hz = 8 .*\[Hz\]'),
    'two gravity components': (setting('gravity_in_base', value=[0.0, -9.81]), 'x, y and z'),
    'gravity is no list': (setting('gravity_in_base', value=9.81), 'must be a list of numbers'),
    'home configuration too short': (
        setting('rest_position', value=[0.0]),
        '1 values for 4 joints',
    ),
    'home configuration outside': (
        setting('rest_position', value=[0.0, -1.0, 0.0, 0.0]),
        'rest_position of joint2 = -1.0',
    ),
    'profile': (setting('profile', value=None), 'profile = None must be a name'),
}


@pytest.mark.parametrize(('change', 'message'), WRONG.values(), ids=WRONG.keys())
def test_an_invalid_file_raises_one_line_that_names_the_key(
    write: Callable[[Change], Path], change: Change, message: str
) -> None:
    path = write(change)
    with pytest.raises(ConfigError, match=message) as caught:
        load_arm_config(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('joints: [', 'not valid YAML'),
        ('- 1', 'mapping'),
        ('', 'mapping'),
        ('name: a\nname: b\n', 'line 2: key name is given twice'),
        ('!!python/object/apply:os.getcwd []', 'not valid YAML'),
    ],
)
def test_a_file_that_holds_no_configuration(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / 'arm.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_arm_config(path)
    assert str(caught.value).startswith(f'{path}: ')


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / 'missing.yaml', tmp_path):
        with pytest.raises(ConfigError, match='check the path'):
            load_arm_config(path)
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ConfigError, match='not valid YAML'):
        load_arm_config(binary)


def test_numbers_may_be_fractions_and_bare_exponents(write: Callable[[Change], Path]) -> None:
    """YAML 1.1 reads 1e-5 as text."""
    path = write(lambda d: d['motors']['MN4004'].update(rotor_inertia='1e-5'))
    config = load_arm_config(path)
    assert config.joints[2].motor.rotor_inertia == 1e-5
    assert config.joints[2].gear.ratio == 1 / 31


def test_a_measured_torque_constant_takes_precedence(write: Callable[[Change], Path]) -> None:
    path = write(lambda d: d['motors']['MN4004'].update(torque_constant_measured=0.03))
    config = load_arm_config(path)
    assert config.joints[2].motor.torque_constant == 0.03
    assert config.joints[2].torque_per_ampere == pytest.approx(0.93)


def test_columns_follow_the_joints() -> None:
    config = load_arm_config()
    assert config.n == 4
    assert config.joint_names == ('joint1', 'joint2', 'joint3', 'joint4')
    assert np.array_equal(config.column('coulomb'), [0.247, 0.103, 0.122, 0.103])
    assert np.array_equal(config.column('motor.current_max'), [20.0, 16.0, 9.0, 16.0])
    with pytest.raises(AttributeError):
        config.column('colour')


def test_a_configuration_cannot_be_changed_but_copied() -> None:
    config = load_arm_config()
    with pytest.raises(FrozenInstanceError):
        config.name = 'other'  # type: ignore[misc]
    hanging = replace(config, gravity_in_base=(0.0, 0.0, 9.81))
    assert isinstance(hanging, ArmConfig)
    assert hanging.gravity_in_base[2] == -config.gravity_in_base[2]
    with pytest.raises(ConfigError, match='at least one joint'):
        replace(config, joints=())
