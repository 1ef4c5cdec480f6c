"""Start the nodes ground_link and view (the browser page) on the ground computer.

ros2 launch aerarm_ros ground_side.launch.py drone:=192.168.1.10
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import PushRosNamespace
from launch_ros.parameter_descriptions import ParameterValue

from aerarm_ros.launch_parts import (
    SHARE,
    arguments_as_parameters,
    arm_parameters,
    check_first,
    drone_argument,
    drone_parameter,
    node,
    switch_argument,
)

ARGUMENTS = (
    DeclareLaunchArgument('drone', description="address of the drone's computer"),
    DeclareLaunchArgument(
        'port', default_value='7447', description="UDP port of ground_link on the drone's computer"
    ),
    DeclareLaunchArgument(
        'namespace',
        default_value='',
        description="namespace of the drone's nodes, which the nodes on the ground also use",
    ),
    DeclareLaunchArgument(
        'tf_prefix',
        default_value='',
        description='prefix of link and joint names, equal to tf_prefix of drone_side.launch.py',
    ),
    DeclareLaunchArgument(
        'config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'aerarm.yaml']),
        description="configuration file of the arm's motors, gears, encoders and limits",
    ),
    DeclareLaunchArgument(
        'urdf',
        default_value=PathJoinSubstitution([SHARE, 'urdf', 'aerarm.urdf']),
        description='URDF of the arm that the browser page shows',
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value=PathJoinSubstitution([SHARE, 'config', 'parameters_fake.yaml']),
        description='parameter file for every node of this launch file',
    ),
    drone_argument(),
    switch_argument('view', 'start view, the server of the browser page', 'true'),
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    text = {
        name: ParameterValue(LaunchConfiguration(name), value_type=str)
        for name in ('drone', 'tf_prefix')
    }
    link = node(
        'ground_link',
        {
            'role': 'ground',
            'drone': text['drone'],
            'tf_prefix': text['tf_prefix'],
            **arguments_as_parameters('port', 'config'),
        },
    )
    condition = IfCondition(LaunchConfiguration('view'))
    nodes = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            link,
            node('view', {**arm_parameters(), **drone_parameter()}, condition=condition),
        ]
    )
    return LaunchDescription([*ARGUMENTS, check_first(), nodes])
