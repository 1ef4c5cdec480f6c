"""Start the bridge, a controller and the node ground_link on the drone's computer.

ros2 launch aerarm_ros drone_side.launch.py hardware:=spi ground:=192.168.1.20

Accepts the arguments of bringup.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import PushRosNamespace
from launch_ros.parameter_descriptions import ParameterValue

from aerarm_ros.launch_parts import SHARE, arguments_as_parameters, bringup, check_first, node

ARGUMENTS = (
    DeclareLaunchArgument(
        'ground_timeout',
        default_value='5.0',
        description='time [s] without a datagram from the ground computer after which the drone '
        'acts according to ground_lost (0: never)',
    ),
    DeclareLaunchArgument(
        'ground_lost',
        default_value='stop',
        choices=['continue', 'stop', 'home'],
        description='reaction of the arm if the connection to the ground computer is lost: '
        'continue the motion, stop on the path, or stop and move to the home configuration',
    ),
    DeclareLaunchArgument(
        'ground',
        default_value='',
        description='address of the ground computer (empty: any computer with the key)',
    ),
    DeclareLaunchArgument(
        'address',
        default_value='0.0.0.0',
        description="local address at which the drone's ground_link receives datagrams",
    ),
    DeclareLaunchArgument(
        'port',
        default_value='7447',
        description="UDP port at which the drone's ground_link receives datagrams",
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    timeout = ParameterValue(LaunchConfiguration('ground_timeout'), value_type=float)
    config = LaunchConfiguration(
        'config', default=PathJoinSubstitution([SHARE, 'config', 'aerarm.yaml'])
    )
    prefix = LaunchConfiguration('tf_prefix', default='')
    link = node(
        'ground_link',
        {
            'role': 'drone',
            'ground_timeout': timeout,
            'config': config,
            'tf_prefix': ParameterValue(prefix, value_type=str),
            'ground': ParameterValue(LaunchConfiguration('ground'), value_type=str),
            **arguments_as_parameters('ground_lost', 'address', 'port'),
        },
    )
    nodes = GroupAction([PushRosNamespace(LaunchConfiguration('namespace', default='')), link])
    return LaunchDescription([*ARGUMENTS, check_first(), bringup(), nodes])
