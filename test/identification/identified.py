"""Runs of the whole identification, by default with the friction of the thesis."""

from collections.abc import Sequence

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import Recording


def identified(
    bags: Recording | Sequence[Recording],
    *validation: Recording,
    robot: Robot | None = None,
    conditioning: ConditioningOptions | None = None,
    friction: str = 'coulomb',
    **options: object,
) -> IdentificationResult:
    """Identify the packaged arm, or `robot` without a configuration of its drives."""
    config = load_arm_config() if robot is None else None
    chosen = IdentificationOptions(conditioning or ConditioningOptions(), friction, **options)
    used = [bags] if isinstance(bags, Recording) else bags
    return identify(robot or load_robot(), config, used, validation, chosen, Stopwatch())
