"""Topic names and quality of service, in one place.

`TOPICS` is the table of the architecture; a node asks for `JOINT_STATES` instead of
writing a name, a type and a profile again. The profiles are those of the suite's
subscriptions; its publishers use `Topic.offered`, so that everybody can listen.
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, InertiaStamped, PointStamped, PoseStamped, WrenchStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory


@dataclass(frozen=True)
class Topic:
    """A topic as every node of the suite knows it.

    Attributes
    ----------
    name
        Relative name, so that a namespace moves the whole arm; `/diagnostics` is absolute
        because the tools that read it expect it there.
    type
        Message class.
    qos
        Profile of the suite's subscriptions.
    """

    name: str
    type: Any
    qos: QoSProfile

    def queued(self, depth: int) -> 'Topic':
        """Return the topic with a queue of that depth, for subscribers that need every message."""
        qos = QoSProfile(
            depth=depth, reliability=self.qos.reliability, durability=self.qos.durability
        )
        return Topic(self.name, self.type, qos)

    @property
    def offered(self) -> QoSProfile:
        """Profile of the suite's publishers: that of its subscriptions, but always reliable.

        A reliable publisher reaches subscriptions of either kind, a best-effort one only its own.
        With a last history it never waits for a slow subscriber: what that has not taken is
        replaced. A best-effort subscription is served as before, and costs no more.
        """
        return QoSProfile(
            history=self.qos.history,
            depth=self.qos.depth,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=self.qos.durability,
        )

    @property
    def type_name(self) -> str:
        """Type as ROS writes it, for example 'sensor_msgs/msg/JointState'."""
        package, folder, *_ = self.type.__module__.split('.')
        return f'{package}/{folder}/{self.type.__name__}'


def _keep_last(
    depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=durability,
    )


# A 1 kHz stream: a late value is worthless, only the newest counts.
NEWEST = _keep_last(1, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
# What a user or planner sends once and expects to arrive.
RELIABLE = _keep_last(10, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
# A state that whoever comes later must still learn.
LATCHED = _keep_last(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
# A sensor read by someone who can use a few old values.
SENSOR = _keep_last(5, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)

JOINT_STATES = Topic('joint_states', JointState, NEWEST)
MOTOR_STATES = Topic('motor_states', JointState, NEWEST)
MOTOR_POWER = Topic('motor_power', Float64MultiArray, NEWEST)
# Joules, a row a cause and a column a joint, as the layout's labels say.
ENERGY = Topic('energy', Float64MultiArray, NEWEST)
JOINT_COMMAND = Topic('joint_command', JointState, NEWEST)
JOINT_TRAJECTORY = Topic('joint_trajectory', JointTrajectory, RELIABLE)
# What a controller will do in the next 0.1 s, from the stamp of a state on.
PLANNED_MOTION = Topic('planned_motion', JointTrajectory, NEWEST)
# Where a planner is to bring the joints, or the tool; and what came of it, a JSON object.
JOINT_GOAL = Topic('joint_goal', JointState, RELIABLE)
TOOL_GOAL = Topic('tool_goal', PointStamped, RELIABLE)
PLAN_STATUS = Topic('plan_status', String, LATCHED)
SET_POINT = Topic('set_point', JointState, RELIABLE)
TOOL_TRAJECTORY = Topic('tool_trajectory', PoseStamped, RELIABLE)
# A timed path of the tool in the odometry's frame: one transform a point.
TOOL_MOTION = Topic('tool_motion', MultiDOFJointTrajectory, RELIABLE)
# How far the base may move until the tool is out of reach: along x, y, z of the world, against them
# [m], and the time until then at its present velocity [s].
ARM_REACH = Topic('arm_reach', Float64MultiArray, NEWEST)
TOOL_POSE = Topic('tool_pose', PoseStamped, NEWEST)
IMU = Topic('imu', Imu, SENSOR)
# Pose of the drone's body in the world, and its twist in body axes.
ODOMETRY = Topic('odometry', Odometry, SENSOR)
# Of an emulated drone: its true state, and what a camera or motion capture beside it makes of it.
TRUE_ODOMETRY = Topic('true_odometry', Odometry, SENSOR)
EXTERNAL_ODOMETRY = Topic('external_odometry', Odometry, SENSOR)
# Thrust of each rotor [N] as effort, by the rotors' names; stamped as the odometry that it answers.
ROTOR_COMMAND = Topic('rotor_command', JointState, NEWEST)
# Where the drone shall hover, or go in time.
FLIGHT_TRAJECTORY = Topic('flight_trajectory', MultiDOFJointTrajectory, RELIABLE)
FLIGHT_SET_POINT = Topic('flight_set_point', PoseStamped, RELIABLE)
BASE_WRENCH = Topic('base_wrench', WrenchStamped, NEWEST)
ARM_INERTIA = Topic('arm_inertia', InertiaStamped, NEWEST)
ARM_COM = Topic('arm_com', PointStamped, NEWEST)
# What the last link carries, in its frame; and friction, a row a kind and a column a joint.
PAYLOAD = Topic('payload', InertiaStamped, NEWEST)
JOINT_FRICTION = Topic('joint_friction', Float64MultiArray, NEWEST)
ARM_MODE = Topic('arm_mode', String, LATCHED)
# What a client that commissions the arm wants of the bridge, again and again, and the answer: JSON
# objects, see `aerarm_ros.hardware.boards.commissioning_probe`.
COMMISSIONING_REQUEST = Topic('commissioning_request', String, RELIABLE)
COMMISSIONING_REPORT = Topic('commissioning_report', String, RELIABLE)
TOOL_PATH = Topic('tool_path', Path, LATCHED)
DISTURBANCE = Topic('disturbance', JointState, NEWEST)
# Of the arm on its drone: its weight along the thrust, and what the joints' motion does; the
# acceleration that rotors add against the latter. Stamped with the time that they are about.
WEIGHT_WRENCH = Topic('base_wrench_weight', WrenchStamped, NEWEST)
MOTION_WRENCH = Topic('base_wrench_motion', WrenchStamped, NEWEST)
FEEDFORWARD_ACCELERATION = Topic('feedforward_acceleration', AccelStamped, NEWEST)
# Of what else touches drone or arm.
CONTACT_WRENCH = Topic('contact_wrench', WrenchStamped, NEWEST)
# Of an arm on any base: torque beyond drives and model; contact yes or no, its confidence, force.
EXTERNAL_TORQUE = Topic('external_torque', JointState, NEWEST)
CONTACT = Topic('contact', Bool, NEWEST)
CONTACT_CONFIDENCE = Topic('contact_confidence', Float64, NEWEST)
CONTACT_FORCE = Topic('contact_force', WrenchStamped, NEWEST)
STATIC_WRENCH = Topic('base_wrench_static', WrenchStamped, NEWEST)
ROBOT_DESCRIPTION = Topic('robot_description', String, LATCHED)
RECORDER_STATUS = Topic('recorder_status', String, LATCHED)
# Of a host that records on another one through ground_link: JSON objects, see
# `aerarm_ros.ros.link.recordings`.
RECORD_REQUEST = Topic('record_request', String, RELIABLE)
RECORD_REPORT = Topic('record_report', String, LATCHED)
# Stamp of the newest joint state that the recorder has.
RECORDED_UNTIL = Topic('recorded_until', Time, NEWEST)
# Of an emulated world, for nodes with use_sim_time.
CLOCK = Topic('/clock', Clock, NEWEST)
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, RELIABLE)

TOPICS = MappingProxyType(
    {
        topic.name: topic
        for topic in (
            JOINT_STATES,
            MOTOR_STATES,
            MOTOR_POWER,
            ENERGY,
            JOINT_COMMAND,
            JOINT_TRAJECTORY,
            PLANNED_MOTION,
            JOINT_GOAL,
            TOOL_GOAL,
            PLAN_STATUS,
            SET_POINT,
            TOOL_TRAJECTORY,
            TOOL_POSE,
            TOOL_MOTION,
            ARM_REACH,
            IMU,
            ODOMETRY,
            TRUE_ODOMETRY,
            EXTERNAL_ODOMETRY,
            ROTOR_COMMAND,
            FLIGHT_SET_POINT,
            FLIGHT_TRAJECTORY,
            BASE_WRENCH,
            ARM_INERTIA,
            ARM_COM,
            STATIC_WRENCH,
            WEIGHT_WRENCH,
            MOTION_WRENCH,
            FEEDFORWARD_ACCELERATION,
            CONTACT_WRENCH,
            EXTERNAL_TORQUE,
            CONTACT,
            CONTACT_CONFIDENCE,
            CONTACT_FORCE,
            DISTURBANCE,
            TOOL_PATH,
            ROBOT_DESCRIPTION,
            PAYLOAD,
            JOINT_FRICTION,
            ARM_MODE,
            COMMISSIONING_REQUEST,
            COMMISSIONING_REPORT,
            RECORDER_STATUS,
            RECORDED_UNTIL,
            DIAGNOSTICS,
            CLOCK,
        )
    }
)
