"""Start the bridge and, if the arguments select them, a controller, RViz and the browser page.

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
        description='motor boards that the bridge uses: emulated (fake) or real (spi)',
    ),
    controller_argument(),
    DeclareLaunchArgument(
        'if_controller_fails',
        default_value='end',
        choices=['end', 'go_on'],
        description="reaction if the controller process ends with an error: 'end' all nodes, or "
        "'go_on' without controller",
    ),
    DeclareLaunchArgument('namespace', default_value='', description='ROS namespace of all nodes'),
    DeclareLaunchArgument(
        'tf_prefix',
        default_value='',
        description='prefix of all link and joint names, for example left_ (with a prefix, nodes '
        'publish frames on the global topics /tf and /tf_static)',
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value=[SHARE, '/config/parameters_', LaunchConfiguration('hardware'), '.yaml'],
        description='parameter file for every node of this launch file',
    ),
    DeclareLaunchArgument(
        'config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'aerarm.yaml']),
        description="configuration file of the arm's motors, gears, encoders and limits",
    ),
    DeclareLaunchArgument(
        'urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='URDF from which the nodes compute the model of the arm, for example '
        'identified.urdf',
    ),
    DeclareLaunchArgument(
        'plant_urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='URDF of the arm that fake_hardware simulates',
    ),
    base_motion_argument(),
    drone_argument(),
    DeclareLaunchArgument(
        'imu_topic', default_value='imu', description="topic of the IMU at the arm's base"
    ),
    enable_argument(),
    switch_argument('rviz', 'start RViz'),
    switch_argument('view', 'start view, the server of the browser page'),
)

ENDS_WITH_CONTROLLER = EqualsSubstitution(LaunchConfiguration('if_controller_fails'), 'end')
# URDF of the real or simulated arm: an identified model in `urdf` must not change the simulated
# arm. The bridge publishes this URDF on robot_description, for RViz and robot_state_publisher.
MOVING_ARM = IfElseSubstitution(
    ON_SPI, LaunchConfiguration('urdf'), LaunchConfiguration('plant_urdf')
)
# Without a prefix, the frames of all arms have the same names, as in the headers of this package's
# messages. Each namespace therefore has its own tf topics, to which its RViz subscribes.
TF_PREFIX = LaunchConfiguration('tf_prefix')
FRAME_TOPICS = [
    (f'/{name}', IfElseSubstitution(EqualsSubstitution(TF_PREFIX, ''), name, f'/{name}'))
    for name in ('tf', 'tf_static')
]

# Each emulated arm has its own simulated time; with a prefix it is on the namespace's clock topic.
CLOCK = ('/clock', IfElseSubstitution(EqualsSubstitution(TF_PREFIX, ''), '/clock', 'clock'))


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    bridge, controller = _bridge(), _controller()
    nodes = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            bridge,
            # All other nodes of this launch file need the bridge.
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
    """Set the suite's Fast DDS profile (docs/decisions.md), unless the user has set a profile."""
    name = 'FASTRTPS_DEFAULT_PROFILES_FILE'
    ours = PathJoinSubstitution([SHARE, 'config', 'fastdds.xml'])
    return SetEnvironmentVariable(name, EnvironmentVariable(name, default_value=ours))


def _bridge() -> Node:
    executable = IfElseSubstitution(ON_SPI, 'hardware_bridge', 'fake_hardware')
    return node(
        executable,
        {**arm_parameters(urdf=MOVING_ARM), **drone_parameter()},
        remappings=[IMU_REMAPPING, CLOCK],  # fake_hardware publishes IMU samples and the clock
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
    """Return the node robot_state_publisher, or a log message if it is not installed.

    The node computes the frames of the links from joint states.
    """
    try:
        get_package_prefix('robot_state_publisher')
    except PackageNotFoundError:
        return [
            LogInfo(
                msg='robot_state_publisher is not installed, so RViz receives no frames: sudo apt '
                'install ros-jazzy-robot-state-publisher'
            )
        ]
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
