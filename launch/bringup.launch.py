"""Start the bridge and, on request, a controller, RViz and the browser view.

ros2 launch aerarm_ros bringup.launch.py hardware:=fake controller:=gravity_compensation rviz:=true
"""

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    LogInfo,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.conditions import IfCondition
from launch.substitutions import (
    EnvironmentVariable,
    EqualsSubstitution,
    FileContent,
    IfElseSubstitution,
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
)
from launch_ros.actions import Node, PushRosNamespace
from launch_ros.parameter_descriptions import ParameterValue

from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.drone_urdf import with_drone
from aerarm_ros.description.urdf_document import UrdfDocument
from aerarm_ros.launch_parts import (
    IMU_REMAPPING,
    ON_SPI,
    SHARE,
    after,
    arm_parameters,
    base_motion_argument,
    check_first,
    controller_argument,
    drone_argument,
    drone_parameter,
    enable_argument,
    end,
    node,
    switch_argument,
)

ARGUMENTS = (
    DeclareLaunchArgument(
        'hardware',
        default_value='fake',
        choices=['fake', 'spi'],
        description='boards that the bridge uses: emulated (fake) or real (spi)',
    ),
    controller_argument(),
    DeclareLaunchArgument(
        'if_controller_fails',
        default_value='end',
        choices=['end', 'go_on'],
        description="if the controller ends: 'end' stops all nodes, 'go_on' keeps the bridge",
    ),
    DeclareLaunchArgument('namespace', default_value='', description='ROS namespace of all nodes'),
    DeclareLaunchArgument(
        'tf_prefix',
        default_value='',
        description='prefix of all link and joint names, for example left_; then frames are on the '
        'global tf topics',
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value=[SHARE, '/config/parameters_', LaunchConfiguration('hardware'), '.yaml'],
        description='parameter file for every node of this launch file',
    ),
    DeclareLaunchArgument(
        'config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'aerarm.yaml']),
        description='drive train configuration of the arm',
    ),
    DeclareLaunchArgument(
        'urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='model of the arm, for example an identified URDF',
    ),
    DeclareLaunchArgument(
        'plant_urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='URDF of the simulated arm (fake hardware only)',
    ),
    base_motion_argument(),
    drone_argument(),
    DeclareLaunchArgument('imu_topic', default_value='imu', description="the base's IMU"),
    enable_argument(),
    switch_argument('rviz', 'start RViz'),
    switch_argument('view', 'start the browser view'),
)

ENDS_WITH_CONTROLLER = EqualsSubstitution(LaunchConfiguration('if_controller_fails'), 'end')
# URDF of the arm that moves; an identified model must not change the emulated arm. The bridge
# publishes this URDF as robot_description, from which RViz and the frames are made.
MOVING_ARM = IfElseSubstitution(
    ON_SPI, LaunchConfiguration('urdf'), LaunchConfiguration('plant_urdf')
)
# Without a prefix, frames have equal names in every namespace, as in the headers of this package's
# messages. So each namespace has its own tf topic, to which its RViz subscribes.
TF_PREFIX = LaunchConfiguration('tf_prefix')
FRAME_TOPICS = [
    (f'/{name}', IfElseSubstitution(EqualsSubstitution(TF_PREFIX, ''), name, f'/{name}'))
    for name in ('tf', 'tf_static')
]

# Each emulated arm has its own simulation time.
CLOCK = ('/clock', IfElseSubstitution(EqualsSubstitution(TF_PREFIX, ''), '/clock', 'clock'))


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    bridge, controller = _bridge(), _controller()
    nodes = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            bridge,
            # Nothing in this launch file works without the bridge.
            after(bridge, 'bridge', end('the bridge has ended')),
            _enable(),
            controller,
            after(controller, 'controller', condition=IfCondition(ENDS_WITH_CONTROLLER)),
            _view(),
            OpaqueFunction(function=_robot_state_publisher),
            *_rviz(),
        ]
    )
    return LaunchDescription([*ARGUMENTS, check_first(), _discovery_profile(), nodes])


def _discovery_profile() -> SetEnvironmentVariable:
    """Set a Fast DDS profile for quick discovery (docs/decisions.md); a user profile stays."""
    name = 'FASTRTPS_DEFAULT_PROFILES_FILE'
    ours = PathJoinSubstitution([SHARE, 'config', 'fastdds.xml'])
    return SetEnvironmentVariable(name, EnvironmentVariable(name, default_value=ours))


def _bridge() -> Node:
    executable = IfElseSubstitution(ON_SPI, 'hardware_bridge', 'fake_hardware')
    return node(
        executable,
        {**arm_parameters(urdf=MOVING_ARM), **drone_parameter()},
        remappings=[IMU_REMAPPING, CLOCK],  # IMU and clock of an emulated drone and world
    )


def _enable() -> Node:
    return Node(
        package='aerarm_ros',
        executable='arm',
        arguments=['enable', '--home', '--wait', 'ready', 'running'],
        condition=IfCondition(LaunchConfiguration('enable')),
        output='screen',
    )


def _controller() -> Node:
    controller = LaunchConfiguration('controller')
    return node(
        controller,
        {**arm_parameters('base_motion'), **drone_parameter()},
        remappings=[IMU_REMAPPING],
        condition=IfCondition(NotEqualsSubstitution(controller, 'none')),
    )


def _view() -> Node:
    condition = IfCondition(LaunchConfiguration('view'))
    return node('view', {**arm_parameters(), **drone_parameter()}, condition=condition)


def _robot_state_publisher(context: LaunchContext) -> list[Node | LogInfo]:
    """Return robot_state_publisher, which turns joint states into frames, if it is installed."""
    try:
        get_package_prefix('robot_state_publisher')
    except PackageNotFoundError:
        return [LogInfo(msg='robot_state_publisher is not installed: no frames for RViz')]
    urdf, prefix = FileContent(MOVING_ARM).perform(context), TF_PREFIX.perform(context)
    if prefix:
        urdf = UrdfDocument(urdf).prefixed_text(prefix)
    drone_file = LaunchConfiguration('drone_file').perform(context)
    if drone_file:
        urdf = with_drone(urdf, load_drone_config(drone_file), prefix)
    # robot_state_publisher latches its URDF too, but the bridge publishes robot_description.
    own_copy = ('robot_description', '~/robot_description')
    return [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            parameters=[
                {'robot_description': ParameterValue(urdf, value_type=str)},
                {'publish_frequency': 50.0},
            ],
            remappings=[own_copy, *FRAME_TOPICS],
        )
    ]


def _rviz() -> list[Node]:
    condition = IfCondition(LaunchConfiguration('rviz'))
    return [
        Node(
            package='rviz2',
            executable='rviz2',
            arguments=[
                *('-d', PathJoinSubstitution([SHARE, 'rviz', 'aerarm.rviz'])),
                *('--fixed-frame', [TF_PREFIX, 'base_link']),
            ],
            remappings=FRAME_TOPICS,
            condition=condition,
        ),
        node('tool_path', arm_parameters(), condition=condition),
    ]
