"""Parameters that controllers and estimators share, and the objects created from their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import Mount
from aerarm_ros.control.base.base_motion_estimator import (
    FULL,
    HOVER,
    MODES,
    NONE,
    BaseMotionEstimator,
)
from aerarm_ros.control.base.feedback_check import OscillationWatch, check_feedback
from aerarm_ros.control.base.free_base_estimator import FREE, AnswerCorrection, FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.base.rotor_wrench import RotorWrench, carrier_parameters
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.references.reference_chase import ReferenceChase
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import checked_payload
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import REACTIONS, Reaction
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

ARM_PARAMETERS = grouped(
    'Base motion',
    *ARM_FILES,
    DRONE_FILE,
    Parameter(
        'base_motion',
        NONE,
        'source of the base motion. none: the base is fixed; attitude, full: the topic imu; '
        "free: prediction from rotor_command, the arm's motion and the masses of drone_file",
        choices=(*MODES, FREE),
    ),
    Parameter('imu_frame', '',
        'URDF link in which the IMU measures; if empty, the IMU frame of the drone file, otherwise '
        'base_link'),
    Parameter('imu_hold_time', 0.1,
        'age above which the node ignores an IMU sample or a rotor command', 's', 0.001,
        10.0),
    Parameter('imu_fade_time', 0.5,
        'duration of the transition from the measured to the configured gravity direction '
        'after the IMU has stopped', 's', 0.01,
        60.0),
    Parameter('imu_cutoff', 60.0,
        "cutoff frequency of the low-pass filter of the base's angular acceleration",
        'Hz', 0.1, 500.0),
    Parameter('imu_latency', 0.0, 'time from the measurement of an IMU sample to its arrival', 's',
        0.0, 0.1),
    Parameter('rotor_latency', 0.0,
        'delay from the arrival of a rotor command to the resulting thrust', 's', 0.0, 0.1),
    Parameter('correction_cutoff', 0.3,
        "frequency above which the controller, with base_motion 'free', uses the predicted "
        'instead of the measured base acceleration',
        'Hz', 0.01, 0.5),
)  # fmt: skip

LOOP_PARAMETERS = grouped(
    'Real time',
    Parameter('state_timeout', 0.1,
        'time without joint_states after which the node warns', 's', 0.005, 10.0),
    *REAL_TIME_PARAMETERS,
)  # fmt: skip

# The same key as in payload.yaml, so that payload.yaml can be used as a parameter file.
PAYLOAD = 'payload.inertial_parameters'

PAYLOAD_PARAMETER = Parameter(
    PAYLOAD,
    [],
    'ten inertial parameters, thesis (3.3), of the payload at the last link, in the frame of '
    'the last joint, as in payload.yaml; no payload if empty',
    'kg, kg m, kg m^2',
    -100.0,
    100.0,
    element=float,
    live=True,
)

MODEL_PARAMETERS = grouped(
    'Model',
    PAYLOAD_PARAMETER,
    Parameter('rotor_inertia', [],
        'rotor inertia of each joint, reflected to the joint (J_m / k_g^2); the values of the '
        'configuration if empty',
        'kg m^2', 0.0, 10.0, element=float),
    Parameter('load_friction', [], (
        'fraction of the transmitted torque that the gears lose, one value or one per joint; the '
        'values of the URDF if empty'
    ), '', 0.0, 1.0,
              element=float),
)  # fmt: skip
"""Parameters of nodes that use the model of the arm and do not compensate friction."""

# This default covers friction, model errors and the rated payload in controllers that must reach
# goals exactly. benchmarks/goals.py compares this compensation with integral action.
REACHING_COMPENSATION = 0.2


def torque_parameters(
    friction_fraction: float = 1.0,
    friction_max: float = 1.0,
    compensation: float = REACHING_COMPENSATION,
) -> tuple[Parameter, ...]:
    """Return the parameters of each controller that computes torques with the arm's model.

    The arguments are the default and the maximum of `friction_fraction`, and the default of
    `compensation`. Compensation by measured velocity needs a maximum below one, so that the arm is
    passive.
    """
    friction = grouped(
        'Model',
        Parameter('friction_file', '', 'estimate.yaml with identified friction, including terms '
            'that a URDF cannot contain (Stribeck friction); the friction of the URDF if empty'),
        Parameter('friction_fraction', friction_fraction,
            'fraction of the modelled joint friction that the controller compensates', '', 0.0,
            friction_max),
        Parameter('friction_width', 0.02,
            'joint velocity at which the controller compensates 3/4 of the dry friction', 'rad/s',
            1e-4, 1.0),
    )  # fmt: skip
    disturbances = grouped(
        'Disturbances',
        Parameter('observer_gain', 30.0,
            'cutoff frequency of the disturbance observer; 0 for no observer', '1/s', 0.0, 1000.0),
        Parameter('compensation', compensation,
            'largest disturbance torque that the controller compensates, as a fraction of '
            'effort_max; 0 for no compensation',
            '', 0.0, 1.0),
    )  # fmt: skip
    payload = grouped(
        'Payload compensation',
        Parameter('hand_over', 0.0,
            'fraction of the payload estimated by payload_estimator that the controller adds to '
            'its model; 0 for no payload compensation',
            '', 0.0, 1.0),
        Parameter('hand_over_mass_rate', 0.2,
            "largest rate at which the controller changes the payload's mass in its model", 'kg/s',
            1e-3, 10.0),
        Parameter('hand_over_centre_rate', 0.1,
            "largest rate at which the controller moves the payload's centre of mass in its model",
            'm/s', 1e-3, 10.0),
    )  # fmt: skip
    return MODEL_PARAMETERS[:1] + friction + MODEL_PARAMETERS[1:] + disturbances + payload


# For each node that plans or limits motions of an arm under a drone.
ROTOR_PARAMETERS = grouped(
    "Drone's limits",
    Parameter('rotor_share', 0.7,
        "largest fraction of each rotor's thrust range that an arm motion may use; the node slows "
        'down faster motions. 0 for no check of rotors and heading. Needs drone_file',
        '', 0.0, 1.0),
    Parameter('heading_max', 0.0873,
        "largest rotation of the drone's heading that an arm motion may cause (default 5 degrees); "
        '0 for no check. Needs drone_file', 'rad', 0.0, 3.2),
    Parameter('heading_frequency', 2.0,
        "natural frequency of the drone's heading control, which the check of heading_max "
        'assumes',
        'rad/s', 0.1, 30.0),
    Parameter('heading_feedforward', False,
        "whether the drone's controller uses the feed-forward of base_reaction, as flight_control "
        'does; the check of heading_max then permits faster motions'),
    Parameter('unknown_payload', 0.25,
        'additional unknown mass at the tool that the check of heading_max assumes; 0 permits '
        'faster motions if all masses are known', 'kg', 0.0, 10.0),
)  # fmt: skip

FOLLOWER_PARAMETERS = ROTOR_PARAMETERS + grouped(
    'Trajectory tracking',
    Parameter('start_tolerance', 0.1,
        'largest accepted distance of the first trajectory point from the present reference',
        'rad', 0.0, 3.0),
    Parameter('path_tolerance', 0.3,
        'tracking error at which the controller aborts a motion; 0 for no check', 'rad', 0.0, 10.0),
    Parameter('goal_tolerance', 0.01,
        'joint position error below which a goal counts as reached; 0 for no check',
        'rad', 0.0, 1.0),
    Parameter('goal_time', 1.0,
        'time after the end of the trajectory within which the arm must reach the goal; 0 for '
        'no limit',
        's', 0.0, 60.0),
    Parameter('stream_timeout', 0.1,
        'time without a new point of a stream after which the controller stops the motion',
        's', 0.005, 10.0),
)  # fmt: skip

REACTION = 'contact_reaction'
REACTION_PARAMETERS = grouped(
    'Contact',
    Parameter(REACTION, Reaction.REPORT.value,
        'reaction of the controller to a contact that contact_estimator publishes: report: '
        'only report it; stop: brake along the path; retreat: move back after the stop; '
        'comply: yield',
        choices=REACTIONS, live=True),
    Parameter('retreat_time', 0.3,
        'time before the contact that determines the retreat: the arm moves to the position '
        'that its reference had at that time',
        's', 0.01, 5.0),
    Parameter('comply_stiffness', 0.02,
        'fraction of kp that the controller applies while the arm complies with a contact',
        '', 1e-4, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class ControlledArm:
    """Configuration, model, limits and drone of an arm; its methods create a controller's parts."""

    config: ArmConfig
    robot: Robot
    limits: JointLimits
    drone: DroneConfig | None = None
    _models: list[Any] = field(default_factory=list)

    @classmethod
    def from_parameters(cls, values: SimpleNamespace) -> ControlledArm:
        """Read URDF, configuration and drone file; raises ValueError if a file is invalid."""
        config, robot = load_arm(values)
        drone = load_drone(values, config, robot)
        return cls(config, robot, JointLimits.from_config(config), drone)

    def dynamics(self, values: SimpleNamespace) -> MovingBaseDynamics:
        """Return a dynamics model of the arm, including the inertia of the motors' rotors."""
        carrier = None
        if values.base_motion == FREE and self.drone is not None:
            carrier = carrier_parameters(self.drone)
        model = MovingBaseDynamics(self.robot, self._rotor_inertia(values), carrier)
        self.load(model, values)
        return model

    def load(self, model: Any, values: SimpleNamespace) -> None:
        """Set the payload of a model by its method `carry`, and store it for later changes."""
        model.carry(_payload(getattr(values, PAYLOAD, [])))
        self._models.append(model)

    def carry(self, payload: Sequence[float]) -> None:
        """Set the payload of all models that `load` received; raises ValueError."""
        for model in self._models:
            model.carry(_payload(payload))

    def friction(self, values: SimpleNamespace) -> FrictionCompensation:
        """Return the friction compensation; raises ValueError if a parameter is invalid."""
        if values.friction_file:
            # Imported here, because most controllers do not need the identifier's libraries.
            from aerarm_ros.identification.files.estimate_file import read_estimate
            from aerarm_ros.online.joint_friction import JointFriction
            from aerarm_ros.online.replay import KnownArm

            estimate = read_estimate(Path(values.friction_file), self.robot)
            known = KnownArm.identified(self.robot, estimate)
            return JointFriction(known, values.friction_width, values.friction_fraction)
        width, fraction = values.friction_width, values.friction_fraction
        robot, load = self.robot, load_share(values, self.robot)
        return FrictionCompensation(robot.viscous, robot.coulomb, width, fraction, load)

    def base(self, values: SimpleNamespace) -> BaseMotionEstimator | FreeBaseEstimator:
        """Return the base-motion estimator that `base_motion` selects; raises ValueError."""
        if values.base_motion == FREE:
            return self._free_base(values)
        self.check_base(values, getattr(values, PAYLOAD, []))
        return self._moved_base(values, values.base_motion)

    def check_base(self, values: SimpleNamespace, payload: Sequence[float]) -> None:
        """Raise ValueError if base_motion 'full' could become unstable with the given payload."""
        if values.base_motion == FULL and self.drone is not None:
            check_feedback(self.drone, self._whole(values, self.drone, payload))

    def hovering_base(self, values: SimpleNamespace) -> BaseMotionEstimator:
        """Return an estimator that assumes a hovering drone, so feed-forward closes no loop."""
        return self._moved_base(values, HOVER)

    def measured_base(self, values: SimpleNamespace) -> BaseMotionEstimator:
        """Return an estimator of the measured base motion, for nodes that do not move the arm."""
        mode = FULL if values.base_motion == FREE else values.base_motion
        return self._moved_base(values, mode)

    def whole_body(self, values: SimpleNamespace, drone: DroneConfig) -> WholeBodyDynamics:
        """Return a dynamics model of arm and drone, with the payload of the parameter."""
        whole = self._whole(values, drone)
        self.load(whole, values)
        return whole

    def _free_base(self, values: SimpleNamespace) -> FreeBaseEstimator:
        drone = self.drone
        if drone is None:
            raise ValueError(
                "base_motion 'free' needs the masses and rotors of the drone: set drone_file, for "
                'example to config/drone.yaml'
            )
        return FreeBaseEstimator(
            self.robot.gravity_in_base,
            RotorWrench(drone, values.imu_hold_time, values.rotor_latency),
            self.whole_body(values, drone),
            self._mount(values) or Mount.aligned(),
            AnswerCorrection(values.correction_cutoff),
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
        """Return the trajectory follower, which converts motions and set points to references."""
        tolerances = FollowerTolerances.uniform(
            self.config.n,
            values.start_tolerance,
            values.path_tolerance or np.inf,
            values.goal_tolerance or np.inf,
            values.goal_time or np.inf,
            values.stream_timeout,
        )
        limited: tuple[Any, ...] = ()
        if (governor := self.governor(values)) is not None:
            limited = governor.govern, ReferenceChase(self.limits, governor.motion_limits)
        return TrajectoryFollower(self.limits, tolerances, *limited)

    def governor(self, values: SimpleNamespace) -> RotorGovernor | None:
        """Return the governor that slows down motions which demand too much of the rotors.

        Without drone, or if `rotor_share` is zero, the result is None. `values` contains the values
        of `ROTOR_PARAMETERS`.
        """
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
    """Return why a new value of the payload parameter is invalid, or an empty string."""
    try:
        checked_payload(_payload(changes.get(PAYLOAD, [])))
    except ValueError as error:
        return f'parameter {PAYLOAD}: {error}'
    return ''


def _payload(values: Sequence[float]) -> Sequence[float]:
    """Return the ten inertial parameters of the payload; ten zeros if the parameter is empty."""
    return values if len(values) else [0.0] * 10


def load_share(values: SimpleNamespace, robot: Robot) -> npt.NDArray[np.float64]:
    """Return the load-dependent friction [-], one value or (n,), from parameter or URDF."""
    given = values.load_friction
    return scalar_or_array(given) if len(given) else robot.load_friction


def scalar_or_array(values: Sequence[float]) -> npt.NDArray[np.float64]:
    """Convert a list to an array, or a list of one value to a number."""
    return np.array(values[0] if len(values) == 1 else values, dtype=float)
