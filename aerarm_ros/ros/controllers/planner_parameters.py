"""Parameters of a planner of motions, and the planner made from them."""

from __future__ import annotations

from types import SimpleNamespace

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings.excitation_config import load_excitation_config
from aerarm_ros.planner.motion_planner import MotionPlanner
from aerarm_ros.planner.plan_settings import ENERGY, OBJECTIVES, PlanSettings
from aerarm_ros.ros.controllers.controller_parameters import (
    ENERGY_PARAMETERS,
    PAYLOAD,
    load_share,
)
from aerarm_ros.ros.parameters.arm_files import ARM_FILES
from aerarm_ros.ros.parameters.parameter import Parameter

_SETTINGS = (
    Parameter('objective', ENERGY, 'what a motion is planned for: energy, time (the quickest), '
              'disturbance (least peak of the moment on the base), or quintic: straight in joint '
              'space, for comparison', choices=OBJECTIVES, live=True),
    Parameter('duration', 2.0, 'of a motion; 0 for as long as is best', 's', 0.0, 60.0, live=True),
    Parameter('time_price', 10.0, 'what a second costs besides the arm where the duration is free, '
              'as the power at which the drone hovers', 'W', 0.0, 1e5, live=True),
    Parameter('smoothness', 0.03, 'price of acceleration squared, for light joints by their '
              'inertia more: joints whose way costs nothing move evenly instead of creeping',
              'J s^3/rad^2', 0.0, 100.0, live=True),
    Parameter('disturbance_price', 0.0, "price of the moment that a motion's reaction puts on the "
              'base, beside energy: 3 trades one for the other', 'J/(Nm)^2/s', 0.0, 1e6, live=True),
    Parameter('velocity_share', 0.9, 'usable share of velocity and acceleration limits', '', 0.01,
              1.0, live=True),
    Parameter('effort_share', 0.8, 'usable share of torque and current limits', '', 0.01, 1.0,
              live=True),
)  # fmt: skip

PLANNER_PARAMETERS = (
    *_SETTINGS,
    Parameter('frame', 'tool0', 'link that a tool goal is for'),
    Parameter('hold_time', 5.0, 'how long the arm stays where a tool goal brings it: the longer, '
              'the more counts what holding takes', 's', 0.0, 3600.0, live=True),
    Parameter('lead', 0.0, 'how long after the newest state a motion begins; 0 for when it arrives',
              's', 0.0, 10.0, live=True),
    *ENERGY_PARAMETERS,
    *ARM_FILES,
    Parameter('excitation_config', '', 'YAML file of clearances and surroundings; the packaged one '
              'if empty'),
)  # fmt: skip


def plan_settings(values: SimpleNamespace) -> dict[str, object]:
    """Return what the parameters say of `PlanSettings`."""
    return {parameter.name: getattr(values, parameter.name) for parameter in _SETTINGS}


def make_planner(values: SimpleNamespace, config: ArmConfig, robot: Robot) -> MotionPlanner:
    """Return the planner; raises ValueError with what to check."""
    model = EnergyModel(config, robot, values.rotor_inertia or None, load_share(values, robot))
    surroundings = load_excitation_config(values.excitation_config or None)
    setup = ExcitationSetup.of_arm(robot, config, surroundings)
    planner = MotionPlanner(model, setup, PlanSettings(**plan_settings(values)))  # type: ignore[arg-type]
    payload = getattr(values, PAYLOAD)
    if len(payload):
        planner.carry(payload)
    return planner
