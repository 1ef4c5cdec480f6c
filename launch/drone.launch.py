"""The arm under a drone: a controller that feels the drone's attitude, and what the drone feels.

ros2 launch aerarm_ros drone.launch.py hardware:=spi autopilot:=px4
Takes the arguments of bringup.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration, PythonExpression
from launch_ros.actions import PushRosNamespace

from aerarm_ros.launch_parts import (
    IMU_REMAPPING,
    after,
    arguments_as_parameters,
    base_motion_argument,
    bringup,
    check_first,
    controller_argument,
    node,
)

ON_PX4 = EqualsSubstitution(LaunchConfiguration('autopilot'), 'px4')
ARGUMENTS = (
    controller_argument('gravity_compensation'),
    base_motion_argument('full'),
    DeclareLaunchArgument(
        'autopilot',
        default_value='mavros',
        choices=['mavros', 'px4'],
        description="whose IMU it is; px4: PX4's own topics, which px4_imu then converts",
    ),
    DeclareLaunchArgument(
        'imu_topic',
        default_value=PythonExpression(
            ["'imu' if '", LaunchConfiguration('autopilot'), "' == 'px4' else '/mavros/imu/data'"]
        ),
        description="the autopilot's IMU, as MAVROS or px4_imu publishes it",
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    reaction = node(
        'base_reaction',
        arguments_as_parameters('config', 'urdf', 'base_motion'),
        remappings=[IMU_REMAPPING],
    )
    px4_imu = node('px4_imu', remappings=[IMU_REMAPPING], condition=IfCondition(ON_PX4))
    drone = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            reaction,
            after(reaction, 'base_reaction'),
            px4_imu,
            after(px4_imu, 'px4_imu'),
        ]
    )
    return LaunchDescription([*ARGUMENTS, check_first(), bringup(), drone])
