"""Follows joint trajectories by inverse dynamics, thesis (2.21).

ros2 launch aerarm_ros computed_torque.launch.py enable:=true view:=true
Takes the arguments of bringup.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    bringup = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', 'bringup.launch.py'])
    return LaunchDescription(
        [
            DeclareLaunchArgument('controller', default_value='computed_torque'),
            IncludeLaunchDescription(bringup),
        ]
    )
