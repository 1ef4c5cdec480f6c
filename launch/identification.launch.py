"""From a moving arm to its model: excitation, recording, identification, then the end.

ros2 launch aerarm_ros identification.launch.py out:=run1
Takes the arguments of bringup.launch.py. On real hardware the motors are enabled by hand, while
everything waits: ros2 run aerarm_ros arm enable
"""

import signal

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    IncludeLaunchDescription,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown, matches_action
from launch.events.process import SignalProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

WAIT_FOR_A_PERSON = 600.0  # [s]

ARGUMENTS = (
    DeclareLaunchArgument('out', default_value='identification', description='new folder'),
    DeclareLaunchArgument('seed', default_value='1', description='seed of the trajectory'),
    DeclareLaunchArgument(
        'periods', default_value='0', description='periods to play; 0: as the file says, or 2'
    ),
    DeclareLaunchArgument(
        'trajectory', default_value="''", description='YAML file to play instead of a random one'
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
    out = LaunchConfiguration('out')
    bag, result = (PathJoinSubstitution([out, name]) for name in ('bag', 'result'))
    recorder = _node('recorder', {'bag': bag})
    excitation = _node(
        'excitation',
        {
            'seed': LaunchConfiguration('seed'),
            'periods': LaunchConfiguration('periods'),
            'trajectory': LaunchConfiguration('trajectory'),
            'config': LaunchConfiguration('config'),
            'subscribers': 2,  # the bridge and the recorder
            'wait_timeout': WAIT_FOR_A_PERSON,
        },
    )
    identifier = ExecuteProcess(
        cmd=[
            ExecutableInPackage(package='aerarm_ros', executable='identifier'),
            *('--bag', bag, '--out', result, '--topic', _states_topic()),
            *('--config', LaunchConfiguration('config'), '--urdf', LaunchConfiguration('urdf')),
        ],
        output='screen',
    )
    stop_recorder = EmitEvent(
        event=SignalProcess(signal_number=signal.SIGINT, process_matcher=matches_action(recorder))
    )
    end = EmitEvent(event=Shutdown(reason='identification has ended'))
    return LaunchDescription(
        [
            *ARGUMENTS,
            IncludeLaunchDescription(bringup),
            recorder,
            excitation,
            _then(excitation, stop_recorder, end),
            _then(recorder, identifier, end),
            _then(identifier, end, end),
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


def _states_topic() -> PythonExpression:
    """Return the name of joint_states inside the namespace, as the bag has it."""
    namespace = LaunchConfiguration('namespace')
    return PythonExpression(["('/' + '", namespace, "' + '/joint_states').replace('//', '/')"])


def _then(process, if_good, if_failed) -> RegisterEventHandler:
    """Let one action follow the end of a process, another one its failure."""

    def choose(event, context):
        return if_good if event.returncode == 0 else if_failed

    return RegisterEventHandler(OnProcessExit(target_action=process, on_exit=choose))
