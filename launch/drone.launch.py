"""Start the arm, a controller that models the drone's reaction, and the publishers for the drone.

ros2 launch aerarm_ros drone.launch.py hardware:=spi autopilot:=px4 drone_file:=my_drone.yaml
Accepts the arguments of bringup.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration, PythonExpression
from launch_ros.actions import PushRosNamespace
from launch_ros.parameter_descriptions import ParameterValue

from aerarm_ros.launch_parts import (
    IMU_REMAPPING,
    after,
    arm_parameters,
    base_motion_argument,
    bringup,
    check_first,
    controller_argument,
    drone_argument,
    drone_parameter,
    node,
)

ON_PX4 = EqualsSubstitution(LaunchConfiguration('autopilot'), 'px4')
BY_OURSELVES = EqualsSubstitution(LaunchConfiguration('autopilot'), 'flight_control')
# The drone must not receive the motion with which world_control reacts to the drone.
NOT_BY_REACTION = ParameterValue(
    PythonExpression(["'", LaunchConfiguration('controller'), "' != 'world_control'"]),
    value_type=bool,
)
ARGUMENTS = (
    controller_argument('gravity_compensation'),
    base_motion_argument('free'),
    drone_argument(),
    DeclareLaunchArgument(
        'autopilot',
        default_value=PythonExpression(
            [
                "'flight_control' if '",
                LaunchConfiguration('hardware', default='fake'),
                "' == 'fake' and '",
                LaunchConfiguration('drone_file', default=''),
                "' else 'mavros'",
            ]
        ),
        choices=['flight_control', 'mavros', 'px4'],
        description='autopilot whose IMU is used: mavros; px4, whose own topics px4_imu '
        'converts; or flight_control, with which this package flies an emulated drone',
    ),
    DeclareLaunchArgument(
        'imu_topic',
        default_value=PythonExpression(
            [
                "'/mavros/imu/data' if '",
                LaunchConfiguration('autopilot'),
                "' == 'mavros' else 'imu'",
            ]
        ),
        description="topic of the autopilot's IMU, as MAVROS or px4_imu publishes it",
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    reaction = node(
        'base_reaction',
        # The feedforward nodes pick the time that they need from the published forecast.
        {
            'lead': 0.06,
            'measured_motion': NOT_BY_REACTION,
            **arm_parameters('base_motion'),
            **drone_parameter(),
        },
        remappings=[IMU_REMAPPING],
    )
    px4_imu = node('px4_imu', remappings=[IMU_REMAPPING], condition=IfCondition(ON_PX4))
    flight = node(
        'flight_control',
        {**arm_parameters(), **drone_parameter()},
        remappings=[IMU_REMAPPING],
        condition=IfCondition(BY_OURSELVES),
    )
    drone = GroupAction(
        [
            PushRosNamespace(LaunchConfiguration('namespace')),
            reaction,
            after(reaction, 'base_reaction'),
            px4_imu,
            after(px4_imu, 'px4_imu'),
            flight,
            after(flight, 'flight_control'),
        ]
    )
    return LaunchDescription([*ARGUMENTS, check_first(), bringup(), drone])
