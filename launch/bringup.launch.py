"""The arm: bridge, and on request a controller, RViz, the browser view.

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
    Command,
    EnvironmentVariable,
    LaunchConfiguration,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node, PushRosNamespace
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('aerarm_ros')
CONTROLLERS = ('gravity_compensation', 'computed_torque', 'impedance_control', 'kinematic_control')

ARGUMENTS = (
    DeclareLaunchArgument(
        'hardware', default_value='fake', choices=['fake', 'spi'], description='boards behind it'
    ),
    DeclareLaunchArgument(
        'controller', default_value='none', choices=['none', *CONTROLLERS], description='law to run'
    ),
    DeclareLaunchArgument('namespace', default_value='', description='in front of every name'),
    DeclareLaunchArgument(
        'params_file',
        default_value=[SHARE, '/config/parameters_', LaunchConfiguration('hardware'), '.yaml'],
        description='parameters of every node started here',
    ),
    DeclareLaunchArgument(
        'config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'aerarm.yaml']),
        description='drive train of the arm',
    ),
    DeclareLaunchArgument(
        'urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='the arm, for example an identified one; emulated boards keep the drawn one',
    ),
    DeclareLaunchArgument(
        'base_motion',
        default_value='none',
        choices=['none', 'attitude', 'full'],
        description='what a controller uses of the IMU',
    ),
    DeclareLaunchArgument('imu_topic', default_value='imu', description="the base's IMU"),
    DeclareLaunchArgument(
        'enable',
        default_value='false',
        choices=['true', 'false'],
        description='switch the motors on when the boards are there: THE ARM MOVES',
    ),
    DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
    DeclareLaunchArgument('view', default_value='false', description='start the browser view'),
)


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    nodes = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            _bridge(),
            _enable(),
            _controller(),
            _view(),
            OpaqueFunction(function=_robot_state_publisher),
            *_rviz(),
        ]
    )
    return LaunchDescription([*ARGUMENTS, _discovery_profile(), nodes])


def _discovery_profile() -> SetEnvironmentVariable:
    """Let processes find each other at once (docs/decisions.md); the user's profile stays."""
    name = 'FASTRTPS_DEFAULT_PROFILES_FILE'
    ours = PathJoinSubstitution([SHARE, 'config', 'fastdds.xml'])
    return SetEnvironmentVariable(name, EnvironmentVariable(name, default_value=ours))


def _bridge() -> Node:
    hardware = LaunchConfiguration('hardware')
    executable = PythonExpression(
        ["'hardware_bridge' if '", hardware, "' == 'spi' else 'fake_hardware'"]
    )
    parameters = [LaunchConfiguration('params_file'), {'config': LaunchConfiguration('config')}]
    return Node(package='aerarm_ros', executable=executable, parameters=parameters, output='screen')


def _enable() -> Node:
    return Node(
        package='aerarm_ros',
        executable='arm',
        arguments=['enable', '--wait-before', 'idle', '--wait', 'ready', 'running'],
        condition=IfCondition(LaunchConfiguration('enable')),
        output='screen',
    )


def _controller() -> Node:
    controller = LaunchConfiguration('controller')
    arm = {name: LaunchConfiguration(name) for name in ('config', 'urdf', 'base_motion')}
    return Node(
        package='aerarm_ros',
        executable=controller,
        parameters=[LaunchConfiguration('params_file'), arm],
        remappings=[('imu', LaunchConfiguration('imu_topic'))],
        condition=IfCondition(PythonExpression(["'", controller, "' != 'none'"])),
        output='screen',
    )


def _view() -> Node:
    arm = {name: LaunchConfiguration(name) for name in ('config', 'urdf')}
    return Node(
        package='aerarm_ros',
        executable='view',
        parameters=[LaunchConfiguration('params_file'), arm],
        condition=IfCondition(LaunchConfiguration('view')),
        output='screen',
    )


def _robot_state_publisher(context: LaunchContext) -> list[Node | LogInfo]:
    """Return the node that turns joint states into frames, where it is installed."""
    try:
        get_package_prefix('robot_state_publisher')
    except PackageNotFoundError:
        return [LogInfo(msg='robot_state_publisher is not installed: no frames for RViz')]
    urdf = ParameterValue(Command(['cat ', LaunchConfiguration('urdf')]), value_type=str)
    return [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            parameters=[{'robot_description': urdf, 'publish_frequency': 50.0}],
        )
    ]


def _rviz() -> list[Node]:
    condition = IfCondition(LaunchConfiguration('rviz'))
    arm = {name: LaunchConfiguration(name) for name in ('config', 'urdf')}
    return [
        Node(
            package='rviz2',
            executable='rviz2',
            arguments=['-d', PathJoinSubstitution([SHARE, 'rviz', 'aerarm.rviz'])],
            condition=condition,
        ),
        Node(package='aerarm_ros', executable='tool_path', parameters=[arm], condition=condition),
    ]
