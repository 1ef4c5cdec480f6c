"""Margins to the limits of torque and current."""

from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.excitation.feasibility.feasibility_report import LimitMargin, peak_margins
from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


def effort_margins(
    names: tuple[str, str],
    limits: MotionLimits,
    model: EffortModel,
    times: FloatArray,
    states: JointReference,
) -> list[LimitMargin]:
    """Return the margins of the torques and currents that states need.

    Parameters
    ----------
    names : what the two limits are called.
    limits : of the joints.
    model : prior inverse dynamics.
    times : (M,) of the states [s].
    states : (M, n) each.
    """
    effort = model.effort(*states)
    current = model.current(effort)
    joints, (torque_name, current_name) = limits.joint_names, names
    return [
        *peak_margins(torque_name, 'Nm', joints, times, effort, limits.effort),
        *peak_margins(current_name, 'A', joints, times, current, limits.current),
    ]
