"""The CAD model as a parameter vector, its bounds, and joints that another joint drives."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import estimate_yaml, read_estimate
from aerarm_ros.identification.files.identified_robot import unwritten
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    ArmParameters,
    JointModel,
    coupled_terms,
    inertia_boxes,
)
from aerarm_ros.identification.recording.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.inertia import from_pseudo_inertia
from aerarm_ros.model.regressor import Regressor


def test_vector_is_the_regressors(robot: Robot, config: ArmConfig) -> None:
    cad = ArmParameters.stated(robot, config)
    model = JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR))
    expected = Regressor(robot, rotor_inertia=True).parameters(
        robot.inertial_parameters, robot.viscous, robot.coulomb, config.column('reflected_inertia')
    )
    assert np.array_equal(cad.vector(model), expected)


def test_urdf_and_configuration_of_different_arms(robot: Robot, config: ArmConfig) -> None:
    other = load_robot(robot.urdf_text.replace('"joint3"', '"elbow"'))
    with pytest.raises(IdentificationError, match='elbow of the URDF are not in the configuration'):
        ArmParameters.stated(other, config)


def test_a_box_is_found_again() -> None:
    half, centre = np.array([0.02, 0.05, 0.3]), np.array([0.1, -0.2, 0.05])
    point = np.append(centre, 1.0)
    matter = 2.0 * (np.outer(point, point) + np.diag([*(half**2 / 3.0), 0.0]))
    found, reach = inertia_boxes(from_pseudo_inertia(matter)[None])
    assert found[0] == pytest.approx(centre)
    assert reach[0] == pytest.approx(half)


VISCOUS, INERTIA = -0.3, 0.08  # torque of joint 3 by the motion of joint 4
COUPLED = (('joint3', 'joint4'),)


def coupled_recording(arm, seed: int) -> Recording:
    """Record the simulated arm with joint 3's drive turned by joint 4."""
    states = arm.states(seed, noise=1.0)
    _, _, dq, ddq = arm.motion(seed)
    states.effort[:, 2] += VISCOUS * dq[:, 3] + INERTIA * ddq[:, 3]
    names = arm.robot.joint_names
    return recording_from_states(f'bag{seed}', states, names, JointMapping({}))


def coupled_result(arm, config: ArmConfig, coupled=COUPLED) -> IdentificationResult:
    options = IdentificationOptions(friction='coulomb', coupled=coupled)
    bags = [coupled_recording(arm, 1)], [coupled_recording(arm, 2)]
    return identify(arm.robot, config, *bags, options, Stopwatch())


def coefficients(estimate: Estimate) -> list[float]:
    names = ('cv_joint3_joint4', 'ca_joint3_joint4')
    return [float(estimate.theta[estimate.model.columns.index(name)]) for name in names]


@pytest.fixture(scope='module')
def coupled(make_arm: Callable, config: ArmConfig) -> IdentificationResult:
    return coupled_result(make_arm(rate=200.0), config)


def test_coefficients_of_either_sign_are_found(
    coupled: IdentificationResult, make_arm: Callable, config: ArmConfig
) -> None:
    estimate = coupled.recommended.estimate
    (told,) = unwritten(estimate)
    assert told.startswith('cv_joint3_joint4, ca_joint3_joint4 are only in estimate.yaml')
    assert coefficients(estimate) == pytest.approx([VISCOUS, INERTIA], rel=0.1)
    assert estimate.physically_consistent
    without = coupled_result(make_arm(rate=200.0), config, ()).recommended.validation[0]
    with_columns = coupled.recommended.validation[0]
    assert with_columns.per_joint_filtered[2] < 0.2 * without.per_joint_filtered[2]


def test_an_estimate_with_them_is_read_back(
    coupled: IdentificationResult, robot: Robot, tmp_path: Path
) -> None:
    estimate, bag = coupled.recommended.estimate, coupled.identification[0]
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(coupled, estimate, np.zeros(4), np.zeros(4)))
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
