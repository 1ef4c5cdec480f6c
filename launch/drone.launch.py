"""Start the bridge, a controller and the node base_reaction for an arm under a drone.

ros2 launch aerarm_ros drone.launch.py hardware:=spi autopilot:=px4 drone_file:=my_drone.yaml

Depending on the argument autopilot, the launch file also starts px4_imu or flight_control. It
accepts the arguments of bringup.launch.py.
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
BY_FLIGHT_CONTROL = EqualsSubstitution(LaunchConfiguration('autopilot'), 'flight_control')
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
        description='autopilot, which is also the source of IMU samples: mavros (topics of '
        "MAVROS); px4 (the node px4_imu converts PX4's topics); or flight_control (node of this "
        'package that flies an emulated drone)',
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
        description='topic on which MAVROS, px4_imu or fake_hardware publishes IMU samples',
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    reaction = node(
        'base_reaction',
        # The stamp of a message is the time that it predicts; the autopilot nodes select by stamp.
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
        condition=IfCondition(BY_FLIGHT_CONTROL),
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
