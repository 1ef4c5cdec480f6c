"""Windows of a motion with a known arm."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.joint_model import ROTOR, THESIS_TERMS, JointModel
from aerarm_ros.identification.rollout import rollout_samples


@pytest.fixture(scope='session')
def model(robot) -> JointModel:
    return JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR))


@pytest.fixture(scope='session')
def true_theta(arm) -> np.ndarray:
    return np.concatenate([arm.inertial.ravel(), arm.viscous, arm.coulomb, arm.rotor])


@pytest.fixture(scope='session')
def samples_of() -> Callable:
    """Return a function that gives the samples of a recording, or of its first seconds."""

    def samples(recording, seconds: float | None = None):
        part = recording if seconds is None else recording.part(0, seconds / recording.duration, '')
        conditioner = Conditioner([recording], ConditioningOptions(cutoff=5.0))
        return rollout_samples(conditioner, replace(part, name='motion'))

    return samples
