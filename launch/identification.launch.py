"""Play an excitation motion, record it, identify the model of the arm, then end.

ros2 launch aerarm_ros identification.launch.py out:=run1

Accepts the arguments of bringup.launch.py. On real hardware the launch file waits until you home
the arm:

ros2 run aerarm_ros arm home

With namespace:=NS:

ros2 run aerarm_ros arm home --ros-args -r __ns:=/NS
"""

import signal

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess
from launch.events import matches_action
from launch.events.process import SignalProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.substitutions import ExecutableInPackage

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
        'out', default_value='identification', description='new folder for the results'
    ),
    DeclareLaunchArgument(
        'seed', default_value='1', description='seed of the random excitation trajectory'
    ),
    DeclareLaunchArgument(
        'periods',
        default_value='0',
        description='number of periods to play (0: the number in the trajectory file, or 2 for a '
        'random trajectory)',
    ),
    DeclareLaunchArgument(
        'trajectory',
        default_value="''",
        description='YAML file of the trajectory to play (empty: a random trajectory)',
    ),
    *MOTION_ARGUMENTS,
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    namespace, out = LaunchConfiguration('namespace'), LaunchConfiguration('out')
    bag, result = (PathJoinSubstitution([out, name]) for name in ('bag', 'result'))
    recorder = node('recorder', {'bag': bag}, namespace=namespace)
    excitation = node(
        'excitation',
        {
            **arm_parameters('seed', 'periods', 'trajectory', 'excitation_config'),
            'wait_for_recorder': True,
            'wait_timeout': WAIT_FOR_A_PERSON,
        },
        namespace=namespace,
    )
    identifier = ExecuteProcess(
        cmd=[
            ExecutableInPackage(package='aerarm_ros', executable='identifier'),
            *('--bag', bag, '--out', result, '--topic', _states_topic()),
            *('--config', LaunchConfiguration('config'), '--urdf', LaunchConfiguration('urdf')),
            *('--tf-prefix', LaunchConfiguration('tf_prefix')),
        ],
        output='screen',
    )
    stop_recorder = EmitEvent(
        event=SignalProcess(signal_number=signal.SIGINT, process_matcher=matches_action(recorder))
    )
    return LaunchDescription(
        [
            *ARGUMENTS,
            check_first(),
            bringup(),
            recorder,
            excitation,
            after(excitation, 'excitation', stop_recorder),
            after(recorder, 'recorder', identifier),
            after(identifier, 'identifier', end('identification has ended')),
        ]
    )


def _states_topic() -> PythonExpression:
    """Return the topic name of joint_states with its namespace, as it appears in the bag."""
    namespace = LaunchConfiguration('namespace')
    return PythonExpression(["('/' + '", namespace, "' + '/joint_states').replace('//', '/')"])
