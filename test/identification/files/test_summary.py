"""The summary has its keys, and the error of each file is that of the file's reader."""

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.files.summary import ExportError, export_errors, summarise
from aerarm_ros.identification.identification_result import IdentificationResult, torque_errors
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.ros.library.identification import IdentifiedArm, load_identified


def test_keys_and_values(result: IdentificationResult) -> None:
    summary = summarise(result, {'a': 1.0, 'b': 0.5})
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
def loaded(make_arm: Callable, robot: Robot, config: ArmConfig) -> IdentificationResult:
    """An arm whose friction grows with its load."""
    arm = make_arm(rate=100.0, load=0.15)
    bags = [[arm.recording(seed, noise=1.0)] for seed in (1, 2)]
    options = IdentificationOptions(friction='load+offset', tilt=False)
    return identify(robot, config, *bags, options, Stopwatch())


@pytest.fixture(scope='module')
def folder(loaded: IdentificationResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return IdentifiedArm(loaded, {}).save(tmp_path_factory.mktemp('saved') / 'result')


@pytest.fixture(scope='module')
def stated(loaded: IdentificationResult) -> dict[str, ExportError]:
    found = export_errors(loaded)
    return {f'{error.file} {error.contents.split(" ")[0].strip(":")}': error for error in found}


def error_of(result: IdentificationResult, torque: Callable[..., np.ndarray]) -> float:
    """Return the error on the validation bag of what a reader predicts for each sample."""
    samples = result.validation[0].samples
    motion = zip(samples.q, samples.dq, samples.ddq, strict=True)
    kept = samples.kept
    predicted = samples.coarse_filter(np.array([torque(*row) for row in motion]))
    return torque_errors(samples.tau[kept], predicted[kept])[0]


def test_the_whole_model_comes_back_in_one_line(
    loaded: IdentificationResult, folder: Path, stated: dict[str, ExportError]
) -> None:
    model = load_identified(folder)
    samples = loaded.validation[0].samples
    motion = samples.q, samples.dq, samples.ddq
    expected = IdentifiedArm(loaded, {}).torque(*motion)
    assert model.torque(*motion) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    sdp = loaded.recommended.validation[0]
    assert stated['estimate.yaml whole'].filtered[-1] == pytest.approx(sdp.filtered)


def test_mujoco_reads_the_mjcf_as_stated(
    loaded: IdentificationResult, folder: Path, stated: dict[str, ExportError]
) -> None:
    model = mujoco.MjModel.from_xml_path(str(folder / 'identified.xml'))
    damping, dry = model.dof_damping.copy(), model.dof_frictionloss.copy()
    model.dof_frictionloss[:], model.dof_damping[:], model.jnt_limited[:] = 0.0, 0.0, 0
    data = mujoco.MjData(model)

    def torque(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        data.qpos, data.qvel, data.qacc = q, dq, ddq
        mujoco.mj_inverse(model, data)
        return data.qfrc_inverse + damping * dq + dry * np.sign(dq)

    assert stated['identified.xml MuJoCo'].filtered[-1] == pytest.approx(
        error_of(loaded, torque), abs=_STEPS
    )


def test_files_that_carry_less_are_worse(stated: dict[str, ExportError]) -> None:
    whole = stated['estimate.yaml whole'].filtered[-1]
    simulator = stated['identified.xml MuJoCo'].filtered[-1]
    assert whole < simulator < stated['identified.urdf Pinocchio'].filtered[-1]
    assert stated['identified.sdf Drake'].filtered[-1] == pytest.approx(simulator)


def test_the_suite_reads_load_dependent_friction_separately(
    loaded: IdentificationResult, folder: Path
) -> None:
    robot = load_robot(folder / 'identified.urdf')
    estimate = loaded.recommended.estimate
    assert robot.load_friction == pytest.approx(estimate.joint_values('fl'))
    assert robot.coulomb == pytest.approx(estimate.joint_values('fs'), abs=1e-9)
