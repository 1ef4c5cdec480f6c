"""Hold the tool in the world frame, or move it along a path, while the drone sways.

Targets arrive on tool_trajectory, timed paths on tool_motion, both in the odometry's frame. A force
on tool_force presses the tool on a wall, and holds this force while the tool follows its target.
Without a target the tool stays where it is when control starts. The node needs the topics odometry,
imu, rotor_command and joint_states.
"""

from collections.abc import Callable
from contextlib import suppress
from inspect import signature
from types import SimpleNamespace
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray

from aerarm_ros.control.base.base_motion import ImuSample, Mount
from aerarm_ros.control.base.free_base_estimator import FREE, AnswerCorrection, FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.control.references.target_follower import TargetFollower
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.ros.controllers.controller_node import ControllerNode, controller_parameters
from aerarm_ros.ros.controllers.controller_parameters import (
    PAYLOAD,
    ROTOR_PARAMETERS,
    ControlledArm,
    torque_parameters,
)
from aerarm_ros.ros.controllers.tool_topics import TARGET_PARAMETERS, make_target_follower
from aerarm_ros.ros.controllers.world_topics import WorldTopics
from aerarm_ros.ros.diagnostics import TOOL_FORCE, TOOL_FORCE_PHASE
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.states.flight_stream import to_odometry_sample
from aerarm_ros.world.base_pose import BasePoseEstimator, OdometryFrames
from aerarm_ros.world.reach import ArmReach
from aerarm_ros.world.rotor_governor import ReactionLimit
from aerarm_ros.world.tool_force import ForceSettings, ToolForce, ToolForceObserver
from aerarm_ros.world.world_law import WorldGains, WorldLaw
from aerarm_ros.world.world_reference import WorldToolReference, planned_joints

_GAINS = WorldGains()
_FORCE = ForceSettings()
_SOON = 3.0  # [s] before the tool leaves the arm's reach, for a warning
_NEAR = 0.02  # [m]
_FRICTION_ERROR = 0.5  # expected error of a joint's dry friction, relative to the friction
# Smallest weight of the predicted base motion; wind lowers the estimated weight.
_TRUST = 0.9
_RECOVERY = 5.0, 0.5  # [rad/s], [m/s^2] of the slow approach after a stop
# With the default gains, drones of 1.3 times the arm's mass crashed, those of 1.7 times did not.
_MASS_RATIO = 1.6

PARAMETERS = controller_parameters(
    *TARGET_PARAMETERS,
    *torque_parameters(friction_fraction=0.9, friction_max=0.95),
    *(p for p in ROTOR_PARAMETERS if p.name == 'rotor_share'),
    *grouped(
        'Tool position in the world',
        Parameter('kp', _GAINS.kp,
            'feedback gain on the tool position error', '1/s^2', 1.0, 2500.0, live=True),
        Parameter('kd', _GAINS.kd,
            'feedback gain on the tool velocity error', '1/s', 0.0, 200.0, live=True),
        Parameter('orientation_weight', _GAINS.orientation_weight, (
            'weight of the orientation goal relative to the posture goal, in directions that the '
            'position goal leaves free'
        ), '', 0.0, 100.0),
        Parameter('posture', [], (
            'joint configuration, in the middle of the reach, that the null-space motion '
            'approaches; the initial configuration if empty'
        ), 'rad', -7.0, 7.0,
                  element=float),
        Parameter('singular_threshold', 0.06,
            'singular value of the generalized Jacobian below which its inverse is damped',
            'm/rad', 1e-4, 1.0),
        Parameter('singular_damping', 0.03, 'damping of the inverse Jacobian at a singularity',
        'm/rad', 1e-4, 1.0),
        Parameter('error_max', 0.05,
            'tool position error at which the controller stops the tool relative to the base',
                  'm', 1e-3, 1.0),
        Parameter('mass_ratio_min', _MASS_RATIO, (
            'smallest ratio of the mass of the drone to the mass of arm and payload that the node '
            'accepts with base_motion free; lighter drones need lower gains'
        ), '', 0.0, 100.0),
    ),
    *grouped(
        'Odometry',
        Parameter('odometry_timeout', 0.2, 'age of the newest odometry above which the '
                                           'controller no longer uses it', 's', 0.01,
                  2.0),
        Parameter('jump_max', 0.5, 'largest accepted jump of the odometry, in m and in rad',
                  'm', 0.01, 10.0),
        Parameter('recovery_speed', 0.1,
            'velocity at which the tool returns to its target after a stop or an odometry jump',
                  'm/s', 1e-3, 1.0),
    ),
    *grouped(
        'Force of the tool',
        Parameter('force_max', _FORCE.force_max, 'largest accepted tool_force', 'N', 0.5, 100.0),
        Parameter('approach_speed', _FORCE.approach_speed,
            'speed at which the tool approaches the wall', 'm/s', 1e-3, 0.2),
        Parameter('approach_max', _FORCE.approach_max,
            'distance after which the approaching tool stops if it has not reached a wall',
            'm', 1e-3, 1.0),
        Parameter('contact_force', _FORCE.contact_force,
            'estimated force above which the controller assumes that the approaching tool has '
            'reached the wall', 'N', 0.2, 50.0),
        Parameter('force_ramp', _FORCE.force_ramp, 'rate at which the commanded force changes',
        'N/s', 0.1, 100.0),
        Parameter('force_gain', _FORCE.force_gain,
            'gain of the integral feedback of the contact force error', '1/s', 0.1, 20.0),
        Parameter('travel_max', _FORCE.travel_max, (
            'distance that the tool may move along the force during contact before the '
            'controller stops the tool'
        ), 'm', 1e-3, 0.5),
    ),
    *grouped(
        'Set point for the drone',
        Parameter('request_drone', False,
            'whether the node publishes on flight_set_point the drone position at which the '
            'arm is in the middle of its reach'),
        Parameter('request_speed', 0.05, "velocity at which the drone's set point moves",
            'm/s', 1e-3, 1.0),
        Parameter('request_deadband', 0.03,
            'distance between the set point and the drone position at which the arm is in the '
            'middle of its reach; below this distance the set point stays constant', 'm', 1e-3,
            1.0),
    ),
)  # fmt: skip


class WorldControlNode(ControllerNode):
    """Controller for tool targets in the world frame, with the control law `WorldLaw`."""

    takes_odometry = True

    parameters = PARAMETERS

    def make_follower(self) -> WorldToolReference:
        """Return the source of the tool's references, with the estimator of the base's pose."""
        values, arm = self.values, self.arm
        kinematics = Kinematics(arm.robot, values.frame)
        mount = Mount.aligned() if arm.drone is None else Mount.from_drone(arm.drone)
        if values.imu_frame:
            mount = Mount.from_robot(arm.robot, values.imu_frame)
        self.pose = BasePoseEstimator(
            OdometryFrames.of(arm.drone, mount),
            values.odometry_timeout,
            values.jump_max,
            values.imu_latency,
            values.recovery_speed,
        )
        slow = TargetFollower(kinematics, _RECOVERY[0], values.recovery_speed, _RECOVERY[1])
        reach = ArmReach(Kinematics(arm.robot, values.frame), arm.limits)
        followers = make_target_follower(values, arm), slow
        self.reference = WorldToolReference(
            self.pose, kinematics, followers, reach.beyond_any, values.error_max
        )
        self.reference.governor = arm.governor(values)
        return self.reference

    def make_law(self, dynamics: MovingBaseDynamics, friction: FrictionCompensation) -> WorldLaw:
        """Return the control law."""
        values, arm = self.values, self.arm
        if isinstance(self.base, FreeBaseEstimator):
            _require_heavy_drone(arm, sum(getattr(values, PAYLOAD)[:1]), values.mass_ratio_min)
            self.base.correction = AnswerCorrection(values.correction_cutoff, trust_min=_TRUST)
        self._planning = Kinematics(arm.robot, values.frame)
        self._inverse = inverse = DampedInverse(values.singular_threshold, values.singular_damping)
        kinematics, posture = Kinematics(arm.robot, values.frame), values.posture or None
        gains = _settings(WorldGains, values)
        law = WorldLaw(dynamics, kinematics, arm.limits, posture, gains, inverse, friction)
        if self.reference.governor is not None:
            law.limit = ReactionLimit(self.reference.governor)
        return law

    def make_observer(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> ToolForceObserver | None:
        """Return the disturbance observer, which also estimates the force of the tool."""
        values, arm = self.values, self.arm
        self._measured = None
        if values.observer_gain == 0.0:
            return None
        self._measured = arm.measured_base(values)
        observer = ToolForceObserver(
            self.law, dynamics, values.observer_gain, self.base, self._measured, friction,
            _FRICTION_ERROR * arm.robot.coulomb,
        )  # fmt: skip
        self.reference.force = ToolForce(observer, _settings(ForceSettings, values))
        return observer

    def subscribe(self) -> None:
        """Subscribe to targets; create publishers of planned motion, tool pose and reach."""
        self.topics = WorldTopics(self, self.reference, self.values)
        self.attend(self.topics)
        self.publish_plan(self._ahead)
        self.take_payload()

    def take_imu(self, sample: ImuSample, now: float) -> None:
        """Pass an IMU sample to all estimators of the base's motion."""
        super().take_imu(sample, now)
        self.pose.offer_imu(sample, now)
        if self._measured is not None:
            # The estimator of the law has already reported what is wrong with a sample.
            with suppress(RejectedInputError):
                self._measured.offer(sample, now)

    def take_odometry(self, message: Odometry, now: float) -> None:
        """Pass an odometry message to the estimator of the base's pose."""
        self.topics.frame = message.header.frame_id
        self.pose.offer_odometry(to_odometry_sample(message), now)

    def _ahead(self, times: NDArray[np.float64]) -> JointReference | None:
        """Return the planned joint motion at times (M,) [s]; it ignores the drone's motion."""
        if self.state is None:
            return None
        now, q = 1e-9 * self.stamp_ns, self.state.q
        planned = self.reference.ahead(times)
        pose = None if planned is None else self.pose.pose(now)
        return planned_joints(self._planning, self._inverse, q, pose, planned, times)

    def on_parameter(self, name: str, value: Any) -> None:
        """Change the control gains."""
        self.law.gains = self.law.gains._replace(**{name: float(value)})

    def warning(self) -> str:
        """Return a warning if the tool is not held in the world or the reach ends soon."""
        if problem := super().warning():
            return problem
        if self.reference.reason:
            return (
                f'the controller holds the tool in the base frame, because {self.reference.reason}'
            )
        recent = tuple(self.topics.recent)
        least = min((margin.least for margin in recent), default=np.inf)
        time = min((margin.time for margin in recent), default=np.inf)
        if least < _NEAR or time < _SOON:
            left = f'the drone may move {1000.0 * least:.0f} mm further'
            if time < _SOON:
                left += f', and at its velocity leaves the reach in {time:.1f} s'
            return f'the arm is near the end of its reach: {left}. Move the drone to the tool'
        if problem := self.pose.warning():
            return problem
        pusher = self.reference.force
        if pusher is not None and pusher.reason:
            return f'the tool no longer presses on the wall: {pusher.reason}'
        return ''

    def describe(self) -> dict[str, object]:
        """Return tool error, age of the odometry and remaining reach, for /diagnostics."""
        pose, margin = self.pose, self.topics.margin
        values: dict[str, object] = {
            **super().describe(),
            'tool': self.reference.reason or 'held in the world',
            'tool error [mm]': round(1e3 * self.reference.error, 1),
            'stops in the base frame': self.reference.stops,
            'odometry frame': self.topics.frame,
            'odometry age [ms]': round(1e3 * pose.age, 1),
            'odometry noise [mm, mm/s]': (1e3 * pose.noise).round(1).tolist(),
            'odometry jumps': pose.jumps,
            'odometry rejected': pose.rejections,
            'smallest singular value [m/rad]': round(self.law.least_singular_value, 4),
        }
        if (pusher := self.reference.force) is not None:
            values[TOOL_FORCE_PHASE] = pusher.phase.value
            values[TOOL_FORCE] = round(pusher.force, 2)
        if margin is not None:
            values['drone may move [mm]'] = round(1e3 * margin.least)
            values['time to end of reach [s]'] = round(margin.time, 1)
        if self.values.base_motion != FREE:
            values['law'] = (
                'with the Jacobian of a fixed base, because the parameter base_motion is not free'
            )
        return values


def _require_heavy_drone(arm: ControlledArm, payload: float, least: float) -> None:
    """Raise ValueError if the drone is too light for the arm with a payload [kg]."""
    assert arm.drone is not None
    mass = float(arm.robot.inertial_parameters[:, 0].sum()) + payload
    ratio = arm.drone.mass / mass
    if ratio < least:
        raise ValueError(
            f'drone_file: the drone is {ratio:.2f} times as heavy as the arm with its payload '
            f'({mass:.2f} kg); a drone this light can become unstable while the arm holds its '
            'tool. Check these masses, or choose gains for light drones (kp 144, kd 24, and those '
            'of the flight controller: docs/how-to/world.md) and set mass_ratio_min (now '
            f'{least:g}) lower'
        )


def _settings(kind: Callable[..., Any], values: SimpleNamespace) -> Any:
    """Return settings whose fields have the values of the parameters with the same names."""
    given = vars(values)
    return kind(**{name: given[name] for name in signature(kind).parameters if name in given})


main = WorldControlNode.main
