"""A joint that feels another one's motion."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import coupled_terms
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import estimate_yaml, read_estimate
from aerarm_ros.identification.files.identified_robot import unwritten
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.solvers.estimate import Estimate

VISCOUS, INERTIA = -0.3, 0.08  # torque of joint 3 by the motion of joint 4
COUPLED = (('joint3', 'joint4'),)


def recording(arm, seed: int) -> Recording:
    """Record the simulated arm with joint 3's drive turned by joint 4."""
    states = arm.states(seed, noise=1.0)
    _, _, dq, ddq = arm.motion(seed)
    states.effort[:, 2] += VISCOUS * dq[:, 3] + INERTIA * ddq[:, 3]
    names = arm.robot.joint_names
    return recording_from_states(f'bag{seed}', states, names, JointMapping({}))


def identified(arm, config: ArmConfig, friction: str, coupled=COUPLED) -> IdentificationResult:
    options = IdentificationOptions(friction=friction, coupled=coupled)
    bags = [recording(arm, 1)], [recording(arm, 2)]
    return identify(arm.robot, config, *bags, options, Stopwatch())


def coefficients(estimate: Estimate) -> list[float]:
    names = ('cv_joint3_joint4', 'ca_joint3_joint4')
    return [float(estimate.theta[estimate.model.columns.index(name)]) for name in names]


@pytest.mark.parametrize('friction', ['coulomb', 'auto'])
def test_coefficients_of_either_sign_are_found(arm, config: ArmConfig, friction: str) -> None:
    estimate = identified(arm, config, friction).recommended.estimate
    (told,) = unwritten(estimate)
    assert told.startswith('cv_joint3_joint4, ca_joint3_joint4 are only in estimate.yaml')
    assert coefficients(estimate) == pytest.approx([VISCOUS, INERTIA], rel=0.1)
    assert estimate.physically_consistent


def test_unseen_motion_needs_the_columns(arm, config: ArmConfig) -> None:
    with_columns, without = (
        identified(arm, config, 'coulomb', coupled).recommended.validation[0]
        for coupled in (COUPLED, ())
    )
    assert with_columns.per_joint_filtered[2] < 0.2 * without.per_joint_filtered[2]


def test_an_estimate_with_them_is_read_back(
    arm, config: ArmConfig, robot: Robot, tmp_path: Path
) -> None:
    result = identified(arm, config, 'coulomb')
    estimate, bag = result.recommended.estimate, result.identification[0]
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(result, estimate, np.zeros(4), np.zeros(4)))
    again = read_estimate(file, robot)
    assert coefficients(again) == coefficients(estimate)
    wanted = bag.predict(estimate.model, estimate.theta)
    found = bag.predict(again.model, again.theta)
    np.testing.assert_allclose(found.filtered, wanted.filtered, atol=1e-9)
    np.testing.assert_allclose(found.raw, wanted.raw, atol=1e-9)


@pytest.mark.parametrize(
    ('pair', 'words'),
    [
        (('joint3', 'elbow'), 'unknown joint elbow'),
        (('joint3', 'joint3'), 'name two different joints'),
    ],
)
def test_wrong_pairs_are_named(robot: Robot, pair: tuple[str, str], words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        coupled_terms(robot.joint_names, [pair])
