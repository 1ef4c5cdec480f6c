"""Both sides of the torque balance pass the same filter."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.model.regressor import Regressor

LOAD = JointTerm(TermKind.LOAD)


def columns_of(arm, robot: Robot, **options: float) -> SampleColumns:
    recording = arm.recording(1)
    conditioner = Conditioner([recording], ConditioningOptions(**options))
    kinematics = conditioner.candidates()[0]
    return SampleColumns(conditioner.condition(recording, kinematics), Regressor(robot))


def parameters(arm, model: JointModel) -> np.ndarray:
    values = {'fv': arm.viscous, 'fs': arm.coulomb, 'Ja': arm.rotor, 'fl': arm.load}
    joints = [values[term.symbol][joint] for joint, term in model.joint_columns]
    return np.concatenate([arm.inertial.ravel(), joints])


@pytest.mark.parametrize('load', [0.0, 0.04])
@pytest.mark.parametrize('cutoff', [2.0, 5.0])
def test_true_parameters_predict_the_filtered_torque(
    make_arm: Callable, robot: Robot, load: float, cutoff: float
) -> None:
    """Even with a cut-off that takes much of the dry friction's steps away."""
    arm = make_arm(load=load)
    bag = columns_of(arm, robot, cutoff=cutoff)
    model = JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR, LOAD))
    predicted = bag.predict(model, parameters(arm, model))
    error = np.linalg.norm(predicted.filtered - bag.samples.tau) / np.linalg.norm(bag.samples.tau)
    assert error < 5e-4
    assert np.median(np.abs(predicted.raw - bag.samples.tau_raw)) < 1e-3


def test_filtering_one_side_only_would_be_wrong(make_arm: Callable, robot: Robot) -> None:
    arm = make_arm()
    bag = columns_of(arm, robot, cutoff=2.0)
    model = JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR))
    predicted = bag.predict(model, parameters(arm, model))
    tau = bag.samples.tau
    assert np.linalg.norm(predicted.raw - tau) > 20 * np.linalg.norm(predicted.filtered - tau)


def test_load_needs_the_links(make_arm: Callable, robot: Robot) -> None:
    bag = columns_of(make_arm(), robot)
    with pytest.raises(ValueError, match='inertial parameters'):
        bag.term(LOAD)
    inertial = robot.inertial_parameters.ravel()
    assert np.allclose(bag.term(LOAD, 2.0 * inertial), 2.0 * bag.term(LOAD, inertial))
    assert np.allclose(bag.links_torque(2.0 * inertial), 2.0 * bag.links_torque(inertial))
