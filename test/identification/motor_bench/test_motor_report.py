"""People, the bench itself and the arm's configuration read the bench's files."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from motor_data import steps

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.resources import resource
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_bench import MotorResult
from aerarm_ros.identification.motor_bench.motor_friction import (
    BOARD,
    VOLTAGE,
    MotorResistance,
    fit_motor_friction,
)
from aerarm_ros.identification.motor_bench.motor_report import (
    bench_html,
    bench_table,
    bench_yaml,
    config_yaml,
    load_earlier,
)


def result(joint: str = 'joint2', motor: str = 'MN4006', **measured: object) -> MotorResult:
    friction = fit_motor_friction(steps(), mounted=True, name=joint)
    return MotorResult(joint, motor, 1 / 27, 0.0218, friction, **measured)


MEASURED = {
    'inertia': (0.02, 1e-4),
    'carried_inertia': (0.01, 1e-3),
    'torque_ratio': (0.97, 2e-3),
    'resistance': MotorResistance(0.171, 0.002, VOLTAGE),
}


def test_the_result_serves_a_later_run(tmp_path: Path) -> None:
    posture = np.array([0.0, 1.5, 0.0, 0.1])
    file = tmp_path / 'motor_bench.yaml'
    file.write_text(bench_yaml([result(**MEASURED)], posture, True, ['beware']))
    earlier = load_earlier(file)
    np.testing.assert_array_equal(earlier.posture, posture)
    np.testing.assert_allclose(earlier.gravity['joint2'], result().friction.gravity)
    entry = yaml.safe_load(file.read_text())['joints']['joint2']
    assert entry['torque_constant'][0] == pytest.approx(0.97 * 0.0218)
    assert entry['b_eq'][0] == pytest.approx(entry['viscous'][0] / 27**2)
    assert (entry['resistance'], entry['resistance_from']) == ([0.171, 0.002], 'voltage')
    # True torque is 0.97 of what was measured, and so is all that was measured by it.
    assert entry['coulomb'][0] == pytest.approx(0.97 * result().friction.coulomb)
    assert entry['rotor_inertia'][0] == pytest.approx((0.97 * 0.02 - 0.01) / 27**2)


def test_the_written_configuration_loads_with_the_measured_values(tmp_path: Path) -> None:
    source = resource('config', 'aerarm.yaml')
    before = load_arm_config(source)
    file = tmp_path / 'config.yaml'
    file.write_text(config_yaml(source, before, [result(**MEASURED)]))
    after = load_arm_config(file)
    drive, old = after.joints[1], before.joints[1]
    assert drive.motor.torque_constant == pytest.approx(0.97 * 0.0218)
    assert drive.motor.rotor_inertia == pytest.approx((0.97 * 0.02 - 0.01) / 27**2)
    assert drive.coulomb == pytest.approx(0.97 * 0.25, rel=0.01)
    assert drive.effort_max < old.effort_max  # a weaker motor than stated
    assert drive.motor.kv == old.motor.kv
    assert (drive.motor.resistance, drive.motor.resistance_std) == (0.171, 0.002)
    # What the balance of energy is computed with, in its own words.
    texts = drive.motor.resistance_text, old.motor.resistance_text
    assert texts == ('0.171 (± 0.002)', '0.15 (an estimate)')
    for joint in (0, 2, 3):
        assert after.joints[joint] == before.joints[joint]

    vague = result(inertia=(0.02, 1e-4), carried_inertia=(0.015, 3e-3))
    assert not vague.rotor_inertia_known
    file.write_text(config_yaml(source, before, [vague]))
    assert load_arm_config(file).joints[1].motor == before.joints[1].motor


@pytest.mark.parametrize('text', ['joints: 3', 'posture: [1]', 'joints: {a: {}}\nposture: [1]'])
def test_other_files_are_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / 'other.yaml'
    file.write_text(text)
    with pytest.raises(IdentificationError, match='is not a motor_bench.yaml'):
        load_earlier(file)
    with pytest.raises(ConfigError, match='none.yaml'):
        load_earlier(tmp_path / 'none.yaml')


def test_table_and_page() -> None:
    stated = MotorResistance(0.15, 0.015, BOARD)
    results = [result('<b>elbow</b>', **MEASURED), result('wrist', resistance=stated)]
    assert '0.171 ± 0.002' in bench_table(results)
    page = bench_html(results, True, ['beware of <i>'])
    assert '<b>elbow' not in page
    assert '&lt;b&gt;elbow' in page
    assert 'beware of &lt;i&gt;' in page
