"""Reading the arm's YAML: valid values are kept, errors are named."""

from pathlib import Path

import pytest
from changed_yaml import MISSING, changed_yaml

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import ConfigError

WRONG = [
    ('speed', 1, 'unknown key speed'),
    ('joints.1.limit', 1, r'joints\[1\] has the unknown key limit'),
    ('joints.2.offset', MISSING, r'joints\[2\] lacks the key offset'),
    ('motors.MN4006.resistance', MISSING, r'motors\.MN4006 lacks the key resistance'),
    ('boards', MISSING, 'lacks the key boards'),
    ('joints', [], 'joints must be a non-empty list'),
    ('motors', [1], 'motors must be a non-empty mapping'),
    ('joints.0', 7, r'joints\[0\] must be a mapping'),
    ('boards.0', 'spi', r'boards\[0\] must be a mapping'),
    ('joints.0.coulomb', 'x', 'coulomb must be a number'),
    ('joints.0.coulomb', True, 'must be a number'),
    ('coupled_joints', [['joint3', 'elbow']], 'must be two different joints'),
    ('coupled_joints', ['joint3'], r"'joint3' must be a pair \[joint, driver\]"),
    ('joints.0.viscous', float('nan'), 'joint1: viscous = nan'),
    ('joints.0.velocity_max', float('inf'), 'velocity_max = inf'),
    ('joints.0.coulomb', -0.1, 'coulomb = -0.1'),
    ('joints.0.position_max', 170, r'position_max = 170.*\[rad\]'),
    ('joints.3.position_min', 2.5, 'below'),
    ('gears.cycloidal.ratio', 31, 'cycloidal: ratio'),
    ('gears.cycloidal.efficiency', 90, 'efficiency = 90'),
    ('motors.MN4004.rotor_inertia', 100.0, r'MN4004: rotor_inertia.*\[kg m\^2\]'),
    ('joints.0.effort_max', 40.0, 'effort_max = 40.0 Nm exceeds the .* Nm of motor MN5006'),
    ('joints.0.sign', 0, 'sign = 0 must be one of 1, -1'),
    ('joints.0.board', 0.5, 'board must be a whole number'),
    ('joints.3.board', 2, 'joint4: board = 2'),
    ('joints.3.channel', 0, 'joint4: board 1, channel 0 is already used by joint joint3'),
    ('boards.1.device', '/dev/spidev0.0', "device '/dev/spidev0.0' occurs twice"),
    ('joints.1.name', 'joint1', "'joint1' occurs twice"),
    ('joints.0.motor', 'MN1', r"joints\[0\]: motor = 'MN1' must be one of the motors MN"),
    ('joints.0.gear', ['x'], 'must be one of the gears'),
    ('boards.0.mode', 4, 'board0: mode = 4'),
    ('boards.0.clock_hz', 8, r'clock_hz = 8 .*\[Hz\]'),
    ('gravity_in_base', [0.0, -9.81], 'x, y and z'),
    ('gravity_in_base', 9.81, 'must be a list of numbers'),
    ('rest_position', [0.0], '1 values for 4 joints'),
    ('rest_position', [0.0, -1.0, 0.0, 0.0], 'rest_position of joint2 = -1.0'),
    ('profile', None, 'profile = None must be a name'),
]


@pytest.mark.parametrize(('key', 'value', 'message'), WRONG)
def test_an_invalid_file_raises_one_line_that_names_the_key(
    tmp_path: Path, key: str, value: object, message: str
) -> None:
    path = changed_yaml(tmp_path, 'aerarm.yaml', {key: value})
    with pytest.raises(ConfigError, match=message) as caught:
        load_arm_config(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('content', 'message'),
    [(b'- 1', 'mapping'), (b'', 'mapping'), (b'\xff\xfe\x00', 'not valid YAML')],
)
def test_a_file_that_holds_no_configuration(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / 'arm.yaml'
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        load_arm_config(path)
    assert str(caught.value).startswith(f'{path}: ')
    for unreadable in (tmp_path / 'missing.yaml', tmp_path):
        with pytest.raises(ConfigError, match='check the path'):
            load_arm_config(unreadable)


def test_numbers_may_be_fractions_and_bare_exponents_and_measured_constants_win(
    tmp_path: Path,
) -> None:
    """YAML 1.1 reads 1e-5 as text."""
    changes = {'motors.MN4004.rotor_inertia': '1e-5'}
    changes |= {'motors.MN4004.torque_constant_measured': 0.03}
    joint = load_arm_config(changed_yaml(tmp_path, 'aerarm.yaml', changes)).joints[2]
    assert joint.motor.rotor_inertia == 1e-5
    assert joint.gear.ratio == 1 / 31
    assert joint.motor.torque_constant == 0.03
    assert joint.torque_per_ampere == pytest.approx(0.93)
