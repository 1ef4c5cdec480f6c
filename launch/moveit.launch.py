"""Start the bridge, the controller computed_torque, and MoveIt's move_group.

ros2 launch aerarm_ros moveit.launch.py enable:=true rviz:=true

Accepts the arguments of bringup.launch.py except namespace and tf_prefix, because MoveIt's frames
and topics are global.
"""

from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration
from launch_ros.actions import Node

from aerarm_ros.launch_parts import ON_SPI, after, bringup, check_first, switch_argument

ARGUMENTS = (
    DeclareLaunchArgument(
        'controller',
        default_value='computed_torque',
        choices=['computed_torque'],
        description='always computed_torque: MoveIt sends planned motions to this controller',
    ),
    switch_argument(
        'use_sim_time',
        'true: MoveIt uses the simulation time on /clock; false for real boards, or if the '
        'parameter pace is real_time',
        IfElseSubstitution(
            EqualsSubstitution(LaunchConfiguration('hardware', default='fake'), 'spi'),
            'false',
            'true',
        ),
    ),
    DeclareLaunchArgument(
        'namespace',
        default_value='',
        choices=[''],
        description="namespace of the nodes; always empty, because MoveIt's topics are global",
    ),
    DeclareLaunchArgument(
        'tf_prefix',
        default_value='',
        choices=[''],
        description='always empty, because the files in config/moveit name links without prefix',
    ),
)
# ROS packages that MoveIt needs, and control_msgs, which the controller needs for goals.
PACKAGES = (
    'control_msgs',
    'moveit_ros_move_group',
    'moveit_planners_ompl',
    'moveit_kinematics',
    'moveit_simple_controller_manager',
    'robot_state_publisher',
)
# Files of config/moveit, and the parameter that contains each of them.
SETTINGS = {
    'kinematics': 'robot_description_kinematics',
    'joint_limits': 'robot_description_planning',
    'controllers': '',
    'planning': '',
}


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    return LaunchDescription(
        [*ARGUMENTS, check_first(*PACKAGES), bringup(), OpaqueFunction(function=_move_group)]
    )


def _move_group(context: LaunchContext) -> list:
    move_group = Node(
        package='moveit_ros_move_group',
        executable='move_group',
        parameters=_parameters(context),
        output='screen',
    )
    return [move_group, after(move_group, 'move_group')]


def _parameters(context: LaunchContext) -> list[dict]:
    urdf = IfElseSubstitution(
        ON_SPI, LaunchConfiguration('urdf'), LaunchConfiguration('plant_urdf')
    ).perform(context)
    folder = Path(get_package_share_directory('aerarm_ros')) / 'config' / 'moveit'
    settings = [
        (below, yaml.safe_load((folder / f'{name}.yaml').read_text()))
        for name, below in SETTINGS.items()
    ]
    return [
        {
            'robot_description': Path(urdf).read_text(),
            'robot_description_semantic': (folder / 'aerarm.srdf').read_text(),
            'publish_robot_description_semantic': True,
            # Joint states have stamps in simulated time, which is slow on a busy host. MoveIt
            # rejects motions of an arm whose state is older than one second.
            'use_sim_time': LaunchConfiguration('use_sim_time').perform(context) == 'true',
        },
        *({below: given} if below else given for below, given in settings),
    ]
