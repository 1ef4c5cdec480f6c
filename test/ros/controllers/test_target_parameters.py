"""The follower of tool targets that a node's parameters ask for."""

from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.controllers.tool_topics import TARGET_PARAMETERS, make_target_follower
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES

DEFAULTS = {parameter.name: parameter.default for parameter in (*ARM_FILES, *TARGET_PARAMETERS)}
UPRIGHT = np.array([0.0, 1.5708, 0.0, 0.0])


@pytest.mark.parametrize(
    ('prefix', 'frame', 'reach'),
    [('', 'tool0', 0.917), ('', 'wrist', 0.817), ('left_', 'tool0', 0.917), ('l', 'ltool0', 0.917)],
)
def test_targets_beyond_the_stretched_arm_are_refused_whatever_the_prefix(
    prefix: str, frame: str, reach: float
) -> None:
    values = SimpleNamespace(**DEFAULTS | {'tf_prefix': prefix, 'frame': frame, 'drone_file': ''})
    follower = make_target_follower(values, ControlledArm.from_parameters(values))
    follower.take_over(UPRIGHT)
    follower.set_target([0.0, 0.0, reach - 0.001], 0.0)
    with pytest.raises(RejectedInputError):
        follower.set_target([0.0, 0.0, reach + 0.001], 0.0)
