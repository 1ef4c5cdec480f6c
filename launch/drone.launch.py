"""The arm under a drone: a controller that feels the drone's attitude, and what the drone feels.

ros2 launch aerarm_ros drone.launch.py hardware:=spi imu_topic:=/mavros/imu/data
Takes the arguments of bringup.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node, PushRosNamespace
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    bringup = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', 'bringup.launch.py'])
    base_reaction = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            Node(
                package='aerarm_ros',
                executable='base_reaction',
                parameters=[
                    LaunchConfiguration('params_file'),
                    {name: LaunchConfiguration(name) for name in ('config', 'urdf', 'base_motion')},
                ],
                remappings=[('imu', LaunchConfiguration('imu_topic'))],
                output='screen',
            ),
        ]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument('controller', default_value='gravity_compensation'),
            DeclareLaunchArgument('base_motion', default_value='full'),
            DeclareLaunchArgument(
                'imu_topic',
                default_value='/mavros/imu/data',
                description="the autopilot's IMU, as MAVROS publishes it",
            ),
            IncludeLaunchDescription(bringup),
            base_reaction,
        ]
    )
