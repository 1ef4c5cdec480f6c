"""Name, message type and quality of service of every topic of the suite.

Nodes import a topic, such as `JOINT_STATES`, instead of repeating its name, type and quality of
service. `Topic.qos` is the profile of the suite's subscriptions. Publishers use `Topic.offered`,
which matches all subscriptions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, InertiaStamped, PointStamped, PoseStamped, WrenchStamped
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory


@dataclass(frozen=True)
class Topic:
    """Name, message type and quality of service of a topic.

    Attributes
    ----------
    name
        Name of the topic. It is relative, so a namespace applies to all topics of an arm. Only
        `/diagnostics` and `/clock` are absolute, as ROS tools expect.
    type
        Message class.
    qos
        Profile of the suite's subscriptions.
    """

    name: str
    type: Any
    qos: QoSProfile

    def queued(self, depth: int) -> 'Topic':
        """Return the topic with queue depth `depth`, for subscribers that need every message."""
        qos = _keep_last(depth, self.qos.reliability, self.qos.durability)
        return Topic(self.name, self.type, qos)

    def publisher(self, node: Node) -> Publisher:
        """Create a publisher of this topic on a node."""
        return node.create_publisher(self.type, self.name, self.offered)

    def subscription(self, node: Node, callback: Callable[[Any], object]) -> Subscription:
        """Subscribe to this topic on a node, whose executor calls `callback` with each message."""
        return node.create_subscription(self.type, self.name, callback, self.qos)

    @property
    def offered(self) -> QoSProfile:
        """Quality of service of the suite's publishers: as for subscriptions, but reliable.

        A reliable publisher matches reliable and best-effort subscriptions, a best-effort publisher
        only best-effort ones. With a keep-last history a reliable publisher never waits for a slow
        subscriber: new messages replace those that the subscriber has not received. Best-effort
        subscriptions work as with a best-effort publisher, at no extra cost.
        """
        return _keep_last(self.qos.depth, ReliabilityPolicy.RELIABLE, self.qos.durability)

    @property
    def type_name(self) -> str:
        """ROS name of the message type, for example 'sensor_msgs/msg/JointState'."""
        package, folder, *_ = self.type.__module__.split('.')
        return f'{package}/{folder}/{self.type.__name__}'


def _keep_last(
    depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability
    )


# For a fast stream in which only the newest message is useful.
NEWEST = _keep_last(1, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
# For a single message of a user or planner that must arrive.
RELIABLE = _keep_last(10, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
# For a state that subscribers also need if they start after its publication.
LATCHED = _keep_last(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
# For a sensor whose subscribers can use a few older messages.
SENSOR = _keep_last(5, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)

JOINT_STATES = Topic('joint_states', JointState, NEWEST)
MOTOR_STATES = Topic('motor_states', JointState, NEWEST)
MOTOR_POWER = Topic('motor_power', Float64MultiArray, NEWEST)
# Energies [J], one row per cause and one column per joint, with labels in the layout.
ENERGY = Topic('energy', Float64MultiArray, NEWEST)
JOINT_COMMAND = Topic('joint_command', JointState, NEWEST)
JOINT_TRAJECTORY = Topic('joint_trajectory', JointTrajectory, RELIABLE)
# Planned motion of a controller in the next 0.1 s after the stamp of a state.
PLANNED_MOTION = Topic('planned_motion', JointTrajectory, NEWEST)
# Goals for the joints or the tool of a planner, and its result as a JSON object.
JOINT_GOAL = Topic('joint_goal', JointState, RELIABLE)
TOOL_GOAL = Topic('tool_goal', PointStamped, RELIABLE)
PLAN_STATUS = Topic('plan_status', String, LATCHED)
SET_POINT = Topic('set_point', JointState, RELIABLE)
TOOL_TRAJECTORY = Topic('tool_trajectory', PoseStamped, RELIABLE)
TOOL_POSE = Topic('tool_pose', PoseStamped, NEWEST)
# A timed path of the tool in the odometry's frame, with one transform per point.
TOOL_MOTION = Topic('tool_motion', MultiDOFJointTrajectory, RELIABLE)
# Desired force of the tool on a wall in the odometry's frame [N]; zero ends the contact. And the
# resulting wrench on drone and arm at the base's origin, in base axes, which the drone compensates.
TOOL_FORCE = Topic('tool_force', WrenchStamped, RELIABLE)
PLANNED_CONTACT = Topic('planned_contact', WrenchStamped, NEWEST)
# Distances that the base can move along x, y, z of the world, and against them, before the tool is
# out of reach [m]. The last entry is the time [s] until the tool is out of reach at the base's
# present velocity.
ARM_REACH = Topic('arm_reach', Float64MultiArray, NEWEST)
IMU = Topic('imu', Imu, SENSOR)
# Pose of the drone's body in the world frame, and its twist in body axes.
ODOMETRY = Topic('odometry', Odometry, SENSOR)
# Odometry of an emulated drone: its true state, and the measurement of an external camera or
# motion capture.
TRUE_ODOMETRY = Topic('true_odometry', Odometry, SENSOR)
EXTERNAL_ODOMETRY = Topic('external_odometry', Odometry, SENSOR)
# Force of an emulated wall on the tool, in the world [N].
TRUE_WALL_FORCE = Topic('true_wall_force', WrenchStamped, SENSOR)
# Rotor names, and the thrust of each rotor [N] as effort, with the stamp of the answered odometry.
ROTOR_COMMAND = Topic('rotor_command', JointState, NEWEST)
# Position at which the drone hovers, and timed path of the drone.
FLIGHT_SET_POINT = Topic('flight_set_point', PoseStamped, RELIABLE)
FLIGHT_TRAJECTORY = Topic('flight_trajectory', MultiDOFJointTrajectory, RELIABLE)
BASE_WRENCH = Topic('base_wrench', WrenchStamped, NEWEST)
ARM_INERTIA = Topic('arm_inertia', InertiaStamped, NEWEST)
ARM_COM = Topic('arm_com', PointStamped, NEWEST)
STATIC_WRENCH = Topic('base_wrench_static', WrenchStamped, NEWEST)
# Predicted wrenches of the arm on its drone, caused by its weight along the thrust and by joint
# motion, and the acceleration by which the rotors compensate the joint motion. The stamp is the
# time of the prediction.
WEIGHT_WRENCH = Topic('base_wrench_weight', WrenchStamped, NEWEST)
MOTION_WRENCH = Topic('base_wrench_motion', WrenchStamped, NEWEST)
FEEDFORWARD_ACCELERATION = Topic('feedforward_acceleration', AccelStamped, NEWEST)
# External wrench on drone and arm, caused by contacts.
CONTACT_WRENCH = Topic('contact_wrench', WrenchStamped, NEWEST)
# External torque of each joint that drives and model do not explain. Whether the arm is in contact,
# the confidence of this decision, and the contact force.
EXTERNAL_TORQUE = Topic('external_torque', JointState, NEWEST)
CONTACT = Topic('contact', Bool, NEWEST)
CONTACT_CONFIDENCE = Topic('contact_confidence', Float64, NEWEST)
CONTACT_FORCE = Topic('contact_force', WrenchStamped, NEWEST)
DISTURBANCE = Topic('disturbance', JointState, NEWEST)
TOOL_PATH = Topic('tool_path', Path, LATCHED)
ROBOT_DESCRIPTION = Topic('robot_description', String, LATCHED)
# Payload of the last link, in its frame; and friction, one row per kind and one column per joint.
PAYLOAD = Topic('payload', InertiaStamped, NEWEST)
JOINT_FRICTION = Topic('joint_friction', Float64MultiArray, NEWEST)
ARM_MODE = Topic('arm_mode', String, LATCHED)
# Repeated request of a commissioning client to the bridge, and its answer: JSON objects, see
# `aerarm_ros.hardware.boards.commissioning_probe`.
COMMISSIONING_REQUEST = Topic('commissioning_request', String, RELIABLE)
COMMISSIONING_REPORT = Topic('commissioning_report', String, RELIABLE)
RECORDER_STATUS = Topic('recorder_status', String, LATCHED)
# Stamp of the newest joint state that the recorder has received.
RECORDED_UNTIL = Topic('recorded_until', Time, NEWEST)
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, RELIABLE)
# Simulated time, for nodes with use_sim_time.
CLOCK = Topic('/clock', Clock, NEWEST)

TOPICS = MappingProxyType(
    {topic.name: topic for topic in tuple(globals().values()) if isinstance(topic, Topic)}
)
"""Topics of the suite by name, which the recorder accepts."""

# Request and report of a computer that records on another computer through ground_link: JSON
# objects, see `aerarm_ros.ros.link.recordings`.
RECORD_REQUEST = Topic('record_request', String, RELIABLE)
RECORD_REPORT = Topic('record_report', String, LATCHED)
