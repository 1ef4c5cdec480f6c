"""The summary has its keys, and the error of each file is that of the file's reader."""

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.files.summary import ReportExtras, export_errors, summarise
from aerarm_ros.identification.identification_result import IdentificationResult, torque_errors
from aerarm_ros.identification.identify import Stopwatch
from aerarm_ros.ros.library.identification import IdentifiedArm, load_identified


def test_keys_and_values(result: IdentificationResult) -> None:
    summary = summarise(result, {'a': 1.0, 'b': 0.5}, ReportExtras())
    json.dumps(summary, allow_nan=False)
    assert summary['samples'] == 10_000
    assert summary['seconds'] == {'a': 1.0, 'b': 0.5, 'total': 1.5}
    thesis, used = (summary['regressor'][name] for name in ('thesis', 'used'))
    assert (thesis['columns'], thesis['rank']) == (48, 30)
    assert (used['columns'], used['rank']) == (52, 32)
    assert 20.0 < thesis['condition_number'] < 150.0
    assert set(summary['solvers']) == {'cad', 'cad_friction', 'ols', 'wls', 'sdp'}
    for solver in summary['solvers'].values():
        for role, bag in (('identification', 'bag1'), ('validation', 'bag2')):
            (entry,) = solver[role]
            assert (entry['bag'], len(entry['per_joint_filtered'])) == (bag, 4)
            assert 0.0 < entry['filtered'] < entry['filtered_measured'] < entry['raw']
    assert summary['gravity']['tilt'] == 0.0
    assert summary['gravity']['stated'] == summary['gravity']['used']
    assert {trial['cutoff'] for trial in summary['conditioning']['trials']} > {5.0}
    assert summary['solvers']['sdp']['physically_consistent']
    assert summary['solvers']['sdp']['validation'][0]['filtered'] == pytest.approx(
        result.recommended.validation[0].filtered
    )


_STEPS = 0.3  # [%] by which errors differ, since steps of friction are filtered at another rate


@pytest.fixture(scope='module')
def loaded(make_arm: Callable) -> IdentificationResult:
    """An arm whose friction grows with its load."""
    arm = make_arm(rate=100.0, load=0.15)
    bags = [arm.recording(seed, noise=1.0) for seed in (1, 2)]
    return identified(*bags, friction='load+offset', tilt=False)


def test_written_files_have_the_errors_that_are_stated(
    loaded: IdentificationResult, tmp_path: Path
) -> None:
    folder = IdentifiedArm(loaded, Stopwatch()).save(tmp_path / 'result')
    whole, simulator, urdf, drake, _ = (each.filtered[-1] for each in export_errors(loaded))
    assert whole == pytest.approx(loaded.recommended.validation[0].filtered)
    assert whole < simulator < urdf
    assert drake == pytest.approx(simulator)
    # The whole model comes back in one line.
    samples = loaded.validation[0].samples
    motion = samples.q, samples.dq, samples.ddq
    expected = IdentifiedArm(loaded, Stopwatch()).torque(*motion)
    assert load_identified(folder).torque(*motion) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    # The suite reads load-dependent friction separately.
    robot, estimate = load_robot(folder / 'identified.urdf'), loaded.recommended.estimate
    assert robot.load_friction == pytest.approx(estimate.joint_values('fl'))
    assert robot.coulomb == pytest.approx(estimate.joint_values('fs'), abs=1e-9)
    # MuJoCo predicts with the stated error, but steps of friction are filtered at another rate.
    model = mujoco.MjModel.from_xml_path(str(folder / 'identified.xml'))
    damping, dry = model.dof_damping.copy(), model.dof_frictionloss.copy()
    model.dof_frictionloss[:], model.dof_damping[:], model.jnt_limited[:] = 0.0, 0.0, 0
    data = mujoco.MjData(model)

    def torque(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        data.qpos, data.qvel, data.qacc = q, dq, ddq
        mujoco.mj_inverse(model, data)
        return data.qfrc_inverse + damping * dq + dry * np.sign(dq)

    rows = np.array([torque(*row) for row in zip(*motion, strict=True)])
    predicted = samples.coarse_filter(rows)[samples.kept]
    assert simulator == pytest.approx(
        torque_errors(samples.tau[samples.kept], predicted)[0], abs=_STEPS
    )
