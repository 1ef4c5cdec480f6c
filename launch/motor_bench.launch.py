"""The drives, one after the other: bench, then the end.

ros2 launch aerarm_ros motor_bench.launch.py out:=bench1 joints:="[joint4]"
Takes the arguments of bringup.launch.py. On real hardware the motors are enabled by hand, while
everything waits: ros2 run aerarm_ros arm enable
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

WAIT_FOR_A_PERSON = 600.0  # [s]

ARGUMENTS = (
    DeclareLaunchArgument('out', default_value='motor_bench', description='new folder'),
    DeclareLaunchArgument(
        'joints',
        default_value='[joint1, joint2, joint3, joint4]',
        description='joints to measure, one after the other',
    ),
    DeclareLaunchArgument(
        'mounted', default_value='true', description='false for bare motors, without gravity'
    ),
    DeclareLaunchArgument(
        'enable',
        default_value=PythonExpression(
            [
                "'true' if '",
                LaunchConfiguration('hardware', default='fake'),
                "' == 'fake' else 'false'",
            ]
        ),
        description='switch the motors on when the boards are there: THE ARM MOVES',
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    bringup = PathJoinSubstitution([FindPackageShare('aerarm_ros'), 'launch', 'bringup.launch.py'])
    bench = _node(
        'motor_bench',
        {
            'out': LaunchConfiguration('out'),
            'joints': LaunchConfiguration('joints'),
            'mounted': LaunchConfiguration('mounted'),
            'config': LaunchConfiguration('config'),
            'urdf': LaunchConfiguration('urdf'),
            'wait_timeout': WAIT_FOR_A_PERSON,
        },
    )
    end = EmitEvent(event=Shutdown(reason='the motor bench has ended'))
    return LaunchDescription(
        [
            *ARGUMENTS,
            IncludeLaunchDescription(bringup),
            bench,
            RegisterEventHandler(OnProcessExit(target_action=bench, on_exit=end)),
        ]
    )


def _node(executable: str, parameters: dict) -> Node:
    return Node(
        package='aerarm_ros',
        executable=executable,
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file'), parameters],
        output='screen',
    )
