"""Parameters that every controller has, and the objects created from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import InertiaStamped
from std_msgs.msg import Header

from aerarm_ros.control.base.base_motion import Mount
from aerarm_ros.control.base.base_motion_estimator import (
    FULL,
    HOVER,
    MODES,
    NONE,
    BaseMotionEstimator,
)
from aerarm_ros.control.base.feedback_check import (
    OscillationWatch,
    check_feedback,
    largest_feedback_gain,
)
from aerarm_ros.control.base.free_base_estimator import FREE, AnswerCorrection, FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.base.rotor_wrench import RotorWrench, carrier_parameters
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.references.reference_chase import ReferenceChase
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import checked_payload
from aerarm_ros.model.inertia import checked_body, parameters_of_body
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import REACTIONS, Array, Reaction
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    DRONE_FILE,
    REAL_TIME_PARAMETERS,
    load_arm,
    load_drone,
)
from aerarm_ros.world.heading import HeadingControl
from aerarm_ros.world.rotor_governor import RotorGovernor


def inertia_message(header: Header, mass: float, centre: Array, inertia: Array) -> InertiaStamped:
    """Return the message of a body's mass properties.

    Parameters
    ----------
    header : Header
        Header with the frame of centre and axes.
    mass : float
        Mass of the body [kg].
    centre : (3,) ndarray
        Centre of mass [m].
    inertia : (3, 3) ndarray
        Inertia about the centre of mass [kg m^2].
    """
    message = InertiaStamped(header=header)
    body, tensor = message.inertia, inertia.tolist()
    body.m = float(mass)
    body.com.x, body.com.y, body.com.z = centre.tolist()
    body.ixx, body.ixy, body.ixz = tensor[0]
    body.iyy, body.iyz, body.izz = tensor[1][1], tensor[1][2], tensor[2][2]
    return message


def body_of_message(message: InertiaStamped) -> Array:
    """Return the inertial parameters (10,) of a message's body, in its frame; raises ValueError."""
    body = message.inertia
    centre = [body.com.x, body.com.y, body.com.z]
    tensor = [
        [body.ixx, body.ixy, body.ixz],
        [body.ixy, body.iyy, body.iyz],
        [body.ixz, body.iyz, body.izz],
    ]
    return checked_body('payload', parameters_of_body(body.m, centre, tensor))


ARM_PARAMETERS = grouped(
    'Base motion',
    *ARM_FILES,
    DRONE_FILE,
    Parameter(
        'base_motion',
        NONE,
        'motion of the base: none; attitude or full, both from the imu topic; or free, which '
        "predicts the base's response to rotor_command and the arm with the masses of drone_file",
        choices=(*MODES, FREE),
    ),
    Parameter('imu_frame', '',
        'URDF link that represents the IMU; if empty, as in the drone file, or base_link'),
    Parameter('imu_hold_time', 0.1,
        'largest usable age of the last IMU sample or rotor command', 's', 0.001, 10.0),
    Parameter('imu_fade_time', 0.5, 'duration of the fallback to nominal gravity', 's', 0.01, 60.0),
    Parameter('imu_cutoff', 60.0,
        "cutoff frequency of the low-pass for the base's angular acceleration", 'Hz', 0.1, 500.0),
    Parameter('imu_latency', 0.0, 'age of an IMU sample on arrival', 's', 0.0, 0.1),
    Parameter('rotor_latency', 0.0,
        'delay from the arrival of rotor_command to its effect on the rotors', 's', 0.0, 0.1),
    Parameter('correction_cutoff', 0.3,
        "crossover frequency of a free base's acceleration: measured below, predicted above",
        'Hz', 0.01, 0.5),
    Parameter('accelerometer_bias', 0.2,
        "largest bias of the IMU's acceleration that the estimator of a free base subtracts",
        'm/s^2', 0.0, 5.0),
)  # fmt: skip

LOOP_PARAMETERS = grouped(
    'Real time',
    Parameter(
        'state_timeout', 0.1, 'silence of joint_states that causes a warning', 's', 0.005, 10.0
    ),
    *REAL_TIME_PARAMETERS,
)

# Key of the payload in payload.yaml, so that the file serves as parameter file.
PAYLOAD = 'payload.inertial_parameters'

PAYLOAD_PARAMETER = Parameter(
    PAYLOAD,
    [],
    'inertial parameters (3.3) of the payload at the last link, in the frame of its joint, as in '
    'payload.yaml; no payload if empty',
    'kg, kg m, kg m^2',
    -100.0,
    100.0,
    element=float,
    live=True,
)

FRICTION_PARAMETERS = grouped(
    'Model',
    PAYLOAD_PARAMETER,
    Parameter('friction_file', '', 'estimate.yaml of the identifier, with friction terms that a '
        'URDF cannot contain (Stribeck friction); friction of the URDF if empty'),
    Parameter('friction_fraction', 1.0,
        "fraction of the URDF's joint friction that is compensated", '', 0, 1),
    Parameter('friction_width', 0.02,
        'velocity at which the compensation reaches 3/4 of the friction', 'rad/s', 1e-4, 1.0),
    Parameter('rotor_inertia', [],
        'rotor inertia at the joints, J_m / k_g^2; as in the configuration if empty',
        'kg m^2', 0.0, 10.0, element=float),
    Parameter('load_friction', [], (
        'fraction of the transmitted torque that the gears lose, one value or one per joint; as '
        'in the URDF written by identifier if empty'
    ), '', 0.0, 1.0,
              element=float),
)  # fmt: skip

# For nodes that use the friction model without compensating friction.
ENERGY_PARAMETERS = tuple(
    parameter
    for parameter in FRICTION_PARAMETERS
    if parameter.name not in ('friction_file', 'friction_fraction', 'friction_width')
)


def observer_parameters(compensation: float) -> tuple[Parameter, ...]:
    """Return the parameters of the disturbance observer, with a default of `compensation`."""
    return grouped(
        'Disturbances',
        Parameter('observer_gain', 30.0,
            'cutoff frequency of the disturbance observer; 0 for no observer', '1/s', 0.0, 1000.0),
        Parameter('compensation', compensation,
            'largest compensated disturbance relative to effort_max; 0 observes without '
                    'compensation',
            '', 0.0, 1.0),
    )  # fmt: skip


# Covers friction, model errors and a rated payload, for a controller that must reach postures.
# benchmarks/goals.py compares this compensation with integral action.
REACHING_COMPENSATION = 0.2

# For every node that plans or limits motions, with the drone of drone_file.
ROTOR_PARAMETERS = grouped(
    "Drone's limits",
    Parameter('rotor_share', 0.7,
        "fraction of each rotor's thrust range that a motion may use, with the drone of "
        'drone_file; faster motions are slowed down. 0 for no check of rotors and heading',
        '', 0.0, 1.0),
    Parameter('heading_max', 0.0873,
        "largest rotation of the drone's heading by a motion of the arm (default 5 degrees), with "
        'the drone of drone_file; 0 for no check', 'rad', 0.0, 3.2),
    Parameter('heading_frequency', 2.0,
        "natural frequency of the drone's heading control, in the prediction of the heading",
        'rad/s', 0.1, 30.0),
    Parameter('heading_feedforward', False,
        "whether the drone's controller feeds the arm's motion forward, as flight_control does "
        'with base_reaction; motions about the vertical axis can then be faster'),
    Parameter('unknown_payload', 0.25,
        'mass at the tool that the arm may carry in addition to the known payload, in the '
        'prediction of the heading; 0 for faster motions of an arm without unknown payload',
        'kg', 0.0, 10.0),
)  # fmt: skip

FOLLOWER_PARAMETERS = ROTOR_PARAMETERS + grouped(
    'Trajectory tracking',
    Parameter(
        'interpolation',
        'quintic',
        'interpolation between trajectory points',
        choices=('cubic', 'quintic'),
    ),
    Parameter(
        'start_tolerance',
        0.1,
        'largest distance of the first trajectory point from the reference',
        'rad',
        0.0,
        3.0,
    ),
    Parameter(
        'path_tolerance',
        0.3,
        'tracking error at which the controller aborts a motion; 0 for no check',
        'rad',
        0.0,
        10.0,
    ),
    Parameter(
        'goal_tolerance',
        0.01,
        'position error below which a goal counts as reached; 0 for no check',
        'rad',
        0.0,
        1.0,
    ),
    Parameter(
        'goal_time',
        1.0,
        'time limit to reach the goal after the end of the trajectory; 0 for no limit',
        's',
        0.0,
        60.0,
    ),
    Parameter(
        'allow_partial_joints_goal',
        True,
        'accept trajectories for some of the joints; the other joints hold their positions',
    ),
    Parameter(
        'stream_timeout',
        0.1,
        'age of the last streamed point at which the controller brakes',
        's',
        0.005,
        10.0,
    ),
)

REACTION = 'contact_reaction'
REACTION_PARAMETERS = grouped(
    'Contact',
    Parameter(
        REACTION,
        Reaction.REPORT.value,
        'reaction to a contact that contact_estimator publishes: only report it, stop along the '
        'path, retreat after the stop, or comply',
        choices=REACTIONS,
        live=True,
    ),
    Parameter(
        'retreat_time',
        0.3,
        'time before the contact at which the reference had the position to which the arm retreats',
        's',
        0.01,
        5.0,
    ),
    Parameter(
        'comply_stiffness', 0.02, 'fraction of kp in effect while the arm complies', '', 1e-4, 1.0
    ),
)


class CarryingModel(Protocol):
    """Interface of an arm's model that can include a payload."""

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the last link, see `Dynamics.carry`."""


@dataclass(frozen=True)
class ControlledArm:
    """The arm's model, configuration and drone for a controller."""

    config: ArmConfig
    robot: Robot
    limits: JointLimits
    drone: DroneConfig | None = None
    _models: list[CarryingModel] = field(default_factory=list)

    @classmethod
    def from_parameters(cls, values: SimpleNamespace) -> ControlledArm:
        """Read the URDF and the configuration; raises ValueError."""
        config, robot = load_arm(values)
        drone = load_drone(values, config, robot)
        if drone is not None:
            # The drone file specifies the mount, and so the direction of gravity.
            robot = robot.with_gravity(drone.gravity_in_base)
        return cls(config, robot, JointLimits.from_config(config), drone)

    def dynamics(self, values: SimpleNamespace) -> MovingBaseDynamics:
        """Return the dynamics model with the rotors' inertia."""
        carrier = None
        if values.base_motion == FREE and self.drone is not None:
            carrier = carrier_parameters(self.drone)
        model = MovingBaseDynamics(self.robot, self._rotor_inertia(values), carrier)
        self.load(model, values)
        return model

    def load(self, model: CarryingModel, values: SimpleNamespace) -> None:
        """Set the arm's payload in a model, now and after each change; raises ValueError."""
        model.carry(_payload(getattr(values, PAYLOAD, [])))
        self._models.append(model)

    def carry(self, payload: Sequence[float]) -> None:
        """Set the payload of every registered model; raises ValueError."""
        for model in self._models:
            model.carry(_payload(payload))

    def friction(self, values: SimpleNamespace) -> FrictionCompensation:
        """Return the compensation of joint friction; raises ValueError with what to check."""
        if values.friction_file:
            # Only now: most controllers do without the libraries of the identifier.
            from aerarm_ros.identification.files.estimate_file import read_estimate
            from aerarm_ros.online.friction_trend import JointFriction
            from aerarm_ros.online.replay import KnownArm

            estimate = read_estimate(Path(values.friction_file), self.robot)
            known = KnownArm.identified(self.robot, estimate)
            return JointFriction(known, values.friction_width, values.friction_fraction)
        viscous, coulomb = self.robot.viscous, self.robot.coulomb
        return FrictionCompensation(
            viscous,
            coulomb,
            values.friction_width,
            values.friction_fraction,
            load_share(values, self.robot),
        )

    def observer(
        self,
        values: SimpleNamespace,
        dynamics: MovingBaseDynamics,
        friction: FrictionCompensation | None,
    ) -> MomentumObserver | None:
        """Return the disturbance observer, or None if its gain is zero."""
        if values.observer_gain == 0.0:
            return None
        return MomentumObserver(dynamics, values.observer_gain, friction)

    def compensation_max(self, values: SimpleNamespace) -> npt.NDArray[np.float64]:
        """Return the largest compensated disturbance torque, (n,) [Nm]."""
        return np.asarray(values.compensation * self.limits.effort_max)

    def base(self, values: SimpleNamespace) -> BaseMotionEstimator | FreeBaseEstimator:
        """Return the estimator of the base's motion; raises ValueError."""
        if values.base_motion == FREE:
            return self._free_base(values)
        self.check_base(values, getattr(values, PAYLOAD, []))
        return self._moved_base(values, values.base_motion)

    def check_base(self, values: SimpleNamespace, payload: Sequence[float]) -> None:
        """Raise ValueError if base_motion `full` is unstable with a payload under this drone."""
        if values.base_motion == FULL and self.drone is not None:
            check_feedback(self.drone, self._whole(values, self.drone, payload))

    def hovering_base(self, values: SimpleNamespace) -> BaseMotionEstimator:
        """Return a base-motion estimator without the drone's reaction, for feedforward to it."""
        return self._moved_base(values, HOVER)

    def measured_base(self, values: SimpleNamespace) -> BaseMotionEstimator:
        """Return an estimator of the base's measured motion, for nodes that command no motion."""
        mode = FULL if values.base_motion == FREE else values.base_motion
        return self._moved_base(values, mode)

    def feedback_gain(self, values: SimpleNamespace) -> float:
        """Return the largest feedback gain of the base's measured motion; 0 without a drone."""
        if self.drone is None:
            return 0.0
        payload = getattr(values, PAYLOAD, [])
        return largest_feedback_gain(self._whole(values, self.drone, payload))

    def whole_body(self, values: SimpleNamespace, drone: DroneConfig) -> WholeBodyDynamics:
        """Return the whole-body model of arm and drone, which follows changes of the payload."""
        whole = self._whole(values, drone)
        self.load(whole, values)
        return whole

    def _free_base(self, values: SimpleNamespace) -> FreeBaseEstimator:
        drone = self.drone
        if drone is None:
            raise ValueError(
                "base_motion 'free' needs the drone's mass and rotors: set drone_file, for "
                'example config/drone.yaml'
            )
        return FreeBaseEstimator(
            self.robot.gravity_in_base,
            RotorWrench(drone, values.imu_hold_time, values.rotor_latency),
            self.whole_body(values, drone),
            self._mount(values) or Mount.aligned(),
            AnswerCorrection(values.correction_cutoff, values.accelerometer_bias),
            values.imu_hold_time,
            values.imu_fade_time,
            values.imu_latency,
        )

    def _whole(
        self, values: SimpleNamespace, drone: DroneConfig, payload: Sequence[float] = ()
    ) -> WholeBodyDynamics:
        carrier = carrier_parameters(drone)
        whole = WholeBodyDynamics(self.robot, self._rotor_inertia(values), carrier)
        whole.carry(_payload(payload))
        return whole

    def _rotor_inertia(self, values: SimpleNamespace) -> npt.ArrayLike:
        given: Sequence[float] = getattr(values, 'rotor_inertia', ())
        return given or self.config.column('reflected_inertia')

    def _mount(self, values: SimpleNamespace) -> Mount | None:
        if values.imu_frame:
            return Mount.from_robot(self.robot, values.imu_frame)
        return None if self.drone is None else Mount.from_drone(self.drone)

    def _moved_base(self, values: SimpleNamespace, mode: str) -> BaseMotionEstimator:
        return BaseMotionEstimator(
            self.robot.gravity_in_base,
            mode,
            self._mount(values),
            values.imu_hold_time,
            values.imu_fade_time,
            values.imu_cutoff,
            values.imu_latency,
            OscillationWatch(self.limits.effort_max),
        )

    def follower(self, values: SimpleNamespace) -> TrajectoryFollower:
        """Return the follower of trajectories and set points."""
        tolerances = FollowerTolerances.uniform(
            self.config.n,
            values.start_tolerance,
            values.path_tolerance or np.inf,
            values.goal_tolerance or np.inf,
            values.goal_time or np.inf,
            values.stream_timeout,
        )
        governor = self.governor(values)
        if governor is None:
            return TrajectoryFollower(self.limits, tolerances, values.interpolation)
        chase = ReferenceChase(self.limits, governor.motion_limits)
        return TrajectoryFollower(
            self.limits, tolerances, values.interpolation, governor.govern, chase
        )

    def governor(self, values: SimpleNamespace) -> RotorGovernor | None:
        """Return the governor of the values of `ROTOR_PARAMETERS`; None without drone or check."""
        if self.drone is None or values.rotor_share == 0.0:
            return None
        heading, unknown = None, 0.0
        if getattr(values, 'heading_max', 0.0):
            unknown = values.unknown_payload
            heading = HeadingControl(
                values.heading_max, values.heading_frequency, values.heading_feedforward
            )
        whole = self.whole_body(values, self.drone)
        gravity = self.robot.gravity_in_base
        return RotorGovernor(whole, self.drone, gravity, values.rotor_share, heading, unknown)


def payload_problem(changes: Mapping[str, Any]) -> str:
    """Return why the payload among changed parameters is invalid, or an empty text."""
    try:
        checked_payload(_payload(changes.get(PAYLOAD, [])))
    except ValueError as error:
        return f'parameter {PAYLOAD}: {error}'
    return ''


def _payload(values: Sequence[float]) -> Sequence[float]:
    """Return the ten inertial parameters of the payload, or ten zeros if none are given."""
    return values if len(values) else [0.0] * 10


def load_share(values: SimpleNamespace, robot: Robot) -> npt.NDArray[np.float64]:
    """Return the load-dependent friction [-], by default the URDF's; one value or (n,)."""
    given = values.load_friction
    return scalar_or_array(given) if len(given) else robot.load_friction


def scalar_or_array(values: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return a list parameter as an array, or as a number if the list has only one value."""
    return np.array(values[0] if len(values) == 1 else values, dtype=float)
