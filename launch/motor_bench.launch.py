"""Measure the drives of the arm with the node motor_bench, joint by joint, then end.

ros2 launch aerarm_ros motor_bench.launch.py out:=bench1 joints:="[joint4]"

Accepts the arguments of bringup.launch.py. On real hardware the launch file waits until you home
the arm:

ros2 run aerarm_ros arm home

With namespace:=NS:

ros2 run aerarm_ros arm home --ros-args -r __ns:=/NS
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

from aerarm_ros.launch_parts import (
    MOTION_ARGUMENTS,
    WAIT_FOR_A_PERSON,
    after,
    arm_parameters,
    bringup,
    check_first,
    end,
    node,
)

ARGUMENTS = (
    DeclareLaunchArgument(
        'out', default_value='motor_bench', description='new folder for the results'
    ),
    DeclareLaunchArgument(
        'joints',
        default_value='[joint1, joint2, joint3, joint4]',
        description='joints whose drives motor_bench measures, one after the other',
    ),
    DeclareLaunchArgument(
        'mounted',
        default_value='true',
        description='true for drives mounted in the arm, false for bare motors',
    ),
    *MOTION_ARGUMENTS,
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    bench = node(
        'motor_bench',
        {
            **arm_parameters('out', 'joints', 'mounted', 'excitation_config'),
            'wait_timeout': WAIT_FOR_A_PERSON,
        },
        namespace=LaunchConfiguration('namespace'),
    )
    done = end('the motor bench has ended')
    return LaunchDescription(
        [*ARGUMENTS, check_first(), bringup(), bench, after(bench, 'motor_bench', done)]
    )
