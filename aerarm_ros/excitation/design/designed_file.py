"""A designed trajectory as a file that says where it comes from."""

from typing import Any

from aerarm_ros.excitation.design.design_result import DesignResult
from aerarm_ros.excitation.design.design_specification import DesignSpecification
from aerarm_ros.excitation.design.trajectory_file import TrajectoryFile, describe_margins


def designed_file(
    specification: DesignSpecification, result: DesignResult, periods: int
) -> TrajectoryFile:
    """Return the file of a design, to be played for some periods."""
    quality = result.quality
    made_with: dict[str, Any] = {
        'objective': specification.objective,
        'seed': specification.seed,
        'start': result.start,
        'condition_number': round(quality.condition_number, 3),
        'scaled_condition_number': round(quality.scaled_condition_number, 3),
        'log_deviation': round(quality.log_deviation, 5),
        'margins': describe_margins(result.report),
        'notes': list(result.report.notes),
    }
    names = specification.setup.limits.joint_names
    return TrajectoryFile(result.trajectory, names, made_with, periods)
