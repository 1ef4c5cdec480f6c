"""The CAD model as a parameter vector, its bounds, and joints that another joint drives."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import estimate_yaml, read_estimate
from aerarm_ros.identification.files.identified_robot import unwritten
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    ArmParameters,
    JointModel,
    LinkBounds,
    coupled_terms,
    inertia_boxes,
)
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
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


def test_a_box_is_found_again() -> None:
    half, centre = np.array([0.02, 0.05, 0.3]), np.array([0.1, -0.2, 0.05])
    point = np.append(centre, 1.0)
    matter = 2.0 * (np.outer(point, point) + np.diag([*(half**2 / 3.0), 0.0]))
    found, reach = inertia_boxes(from_pseudo_inertia(matter)[None])
    assert found[0] == pytest.approx(centre)
    assert reach[0] == pytest.approx(half)


VISCOUS, INERTIA = -0.3, 0.08  # torque of joint 3 by the motion of joint 4


def coefficients(estimate: Estimate) -> list[float]:
    names = ('cv_joint3_joint4', 'ca_joint3_joint4')
    return [float(estimate.theta[estimate.model.columns.index(name)]) for name in names]


def test_coefficients_of_coupled_joints_are_found_and_read_back(
    make_arm: Callable, robot: Robot, tmp_path: Path
) -> None:
    """Coefficients of either sign, for a joint whose drive another joint turns."""
    arm, bags = make_arm(rate=200.0), []
    for seed in (1, 2):
        states = arm.states(seed, noise=1.0)
        _, _, dq, ddq = arm.motion(seed)
        states.effort[:, 2] += VISCOUS * dq[:, 3] + INERTIA * ddq[:, 3]
        bags.append(recording_from_states(f'bag{seed}', states, states.names, JointMapping({})))
    found, without = (
        identified(*bags, coupled=coupled) for coupled in ((('joint3', 'joint4'),), ())
    )
    estimate, bag = found.recommended.estimate, found.identification[0]
    (told,) = unwritten(estimate)
    assert told.startswith('cv_joint3_joint4, ca_joint3_joint4 are only in estimate.yaml')
    assert coefficients(estimate) == pytest.approx([VISCOUS, INERTIA], rel=0.1)
    assert estimate.physically_consistent
    errors = [r.recommended.validation[0].per_joint_filtered[2] for r in (found, without)]
    assert errors[0] < 0.2 * errors[1]
    file = tmp_path / 'estimate.yaml'
    file.write_text(estimate_yaml(found, estimate, np.zeros(4), np.zeros(4)))
    again = read_estimate(file, robot)
    assert coefficients(again) == coefficients(estimate)
    wanted, read = (bag.predict(e.model, e.theta) for e in (estimate, again))
    np.testing.assert_allclose(read.filtered, wanted.filtered, atol=1e-9)
    np.testing.assert_allclose(read.raw, wanted.raw, atol=1e-9)


def test_wrong_inputs_are_named(robot: Robot, config: ArmConfig) -> None:
    for other, words in (('elbow', 'unknown joint elbow'), ('joint3', 'two different joints')):
        with pytest.raises(IdentificationError, match=words):
            coupled_terms(robot.joint_names, [('joint3', other)])
    renamed = load_robot(robot.urdf_text.replace('"joint3"', '"elbow"'))
    with pytest.raises(IdentificationError, match='elbow of the URDF are not in the configuration'):
        ArmParameters.stated(renamed, config)
    for masses in ((2.0, 1.0), (-1.0, 1.0), (0.0, float('nan'))):
        with pytest.raises(IdentificationError, match='total mass'):
            LinkBounds(masses)
