"""What the launch files have in common.

Only they import this module: nothing else needs ROS's launch, which not every host has.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Mapping
from typing import Any

from launch import Action, Condition, LaunchContext, SomeSubstitutionsType
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import (
    EqualsSubstitution,
    LaunchConfiguration,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from aerarm_ros.executables import controllers
from aerarm_ros.launch_requirements import missing, packaged_files
from aerarm_ros.ros.process.die_with_parent import LAUNCH_PID
from aerarm_ros.ros.process.node_process import STOP_TIMEOUT
from aerarm_ros.ros.process.process_end import INTERRUPTED

SHARE = FindPackageShare('aerarm_ros')
WAIT_FOR_A_PERSON = 600.0  # [s]
# Exit status that asyncio's child watcher makes up for a process that it has not seen end.
_UNKNOWN = 255
ON_SPI = EqualsSubstitution(LaunchConfiguration('hardware'), 'spi')
IMU_REMAPPING = ('imu', LaunchConfiguration('imu_topic'))


def switch_argument(
    name: str, description: str, default: SomeSubstitutionsType = 'false'
) -> DeclareLaunchArgument:
    """Return an argument that is true or false."""
    return DeclareLaunchArgument(
        name, default_value=default, choices=['true', 'false'], description=description
    )


def drone_argument() -> DeclareLaunchArgument:
    """Return the argument that names the drone."""
    return DeclareLaunchArgument(
        'drone_file',
        default_value='',
        description='drone that carries the arm, for example config/drone.yaml; none if empty',
    )


def drone_parameter() -> dict[str, ParameterValue]:
    """Return the parameter that names the drone; an empty text stays one."""
    return {'drone_file': ParameterValue(LaunchConfiguration('drone_file'), value_type=str)}


def arm_parameters(
    *others: str, urdf: SomeSubstitutionsType | None = None
) -> dict[str, SomeSubstitutionsType | ParameterValue]:
    """Return the parameters that name the arm, and those of other arguments.

    Parameters
    ----------
    others
        Names of launch arguments that are names of parameters too.
    urdf
        Instead of the argument `urdf`.
    """
    prefix = ParameterValue(LaunchConfiguration('tf_prefix'), value_type=str)
    given = {**arguments_as_parameters('config', 'urdf', *others), 'tf_prefix': prefix}
    return given if urdf is None else {**given, 'urdf': urdf}


def enable_argument(default: SomeSubstitutionsType = 'false') -> DeclareLaunchArgument:
    """Return the argument that enables the motors."""
    what = (
        'switch the motors on when the boards are there, and home an arm whose zeros are unknown: '
        'THE ARM MOVES, from its home configuration'
    )
    return switch_argument('enable', what, default)


def controller_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the argument that chooses the controller."""
    return DeclareLaunchArgument(
        'controller',
        default_value=default,
        choices=['none', *controllers()],
        description='law to run',
    )


def base_motion_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the launch argument for a controller's use of the IMU."""
    return DeclareLaunchArgument(
        'base_motion',
        default_value=default,
        choices=['none', 'attitude', 'full', 'free'],
        description='how the base moves: as the IMU says, or free, as the drone_file says',
    )


# Of the launch files that move the arm by themselves. Only emulated motors are switched on
# unasked; and two nodes that command would fight, so there is no controller to choose.
MOTION_ARGUMENTS = (
    enable_argument(
        PythonExpression(
            [
                "'true' if '",
                LaunchConfiguration('hardware', default='fake'),
                "' == 'fake' else 'false'",
            ]
        )
    ),
    DeclareLaunchArgument(
        'controller',
        default_value='none',
        choices=['none'],
        description='none: the arm is moved by what is started here',
    ),
    DeclareLaunchArgument(
        'excitation_config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'excitation.yaml']),
        description='surroundings of the arm and usable shares of its limits',
    ),
)


def check_first(*packages: str) -> OpaqueFunction:
    """Return what comes before all processes: nothing starts unless everything can.

    Arguments that name a packaged file become its path. What is started then ends when launch is
    gone, however that ends.

    Parameters
    ----------
    packages
        Of ROS, that the launch file needs whatever its arguments.
    """

    def check(context: LaunchContext) -> list[Action]:
        problems = missing(context.launch_configurations, packages)
        if problems:
            raise RuntimeError('; '.join(problems))
        context.launch_configurations.update(packaged_files(context.launch_configurations))
        _keep_launch_from_being_interrupted()
        return [SetEnvironmentVariable(LAUNCH_PID, str(os.getpid()))]

    return OpaqueFunction(function=check)


def _keep_launch_from_being_interrupted() -> None:
    """Leave SIGINT to launch's event loop.

    Launch reads signals from its wakeup file descriptor and leaves Python's own handler in place.
    That handler raises KeyboardInterrupt in whichever task of launch runs: launch then waits for
    that task for ever, or misses the end of a process. Where SIGINT is ignored, as for what a
    script starts in the background, nothing reaches the descriptor.
    """
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, signal.SIG_IGN):
        signal.signal(signal.SIGINT, lambda number, frame: None)


def bringup() -> IncludeLaunchDescription:
    """Return bringup.launch.py, with the arguments that are set where it is included."""
    return IncludeLaunchDescription(PathJoinSubstitution([SHARE, 'launch', 'bringup.launch.py']))


def node(
    executable: SomeSubstitutionsType, parameters: Mapping[str, Any] | None = None, **options: Any
) -> Node:
    """Return a node of this package with the parameter file's values, then the given ones.

    Launch asks a second time after `sigterm_timeout` [s], and a node asked twice ends at once: that
    is 5 s where nobody says otherwise, in which a recorder on a busy host is not done with its bag.
    """
    return Node(
        sigterm_timeout=LaunchConfiguration('sigterm_timeout', default=str(STOP_TIMEOUT)),
        package='aerarm_ros',
        executable=executable,
        parameters=[LaunchConfiguration('params_file'), *([parameters] if parameters else [])],
        output='screen',
        **options,
    )


def arguments_as_parameters(*names: str) -> dict[str, LaunchConfiguration]:
    """Return parameters that have the values of the launch arguments of the same names."""
    return {name: LaunchConfiguration(name) for name in names}


def end(reason: str) -> EmitEvent:
    """Return the end of everything, with exit status 0."""
    return EmitEvent(event=Shutdown(reason=reason))


def after(
    process: Action, what: str, if_good: Action | None = None, condition: Condition | None = None
) -> RegisterEventHandler:
    """Let an action follow a process; if that fails, launch ends with exit status 1.

    To be cut short is no failure while launch itself is being ended. Nor is a status that launch
    does not know: where a Ctrl-C interrupts what awaits a process, asyncio calls that 255.
    """

    def choose(event: ProcessExited, context: LaunchContext) -> Action | None:
        if context.is_shutdown and event.returncode in (0, INTERRUPTED, _UNKNOWN):
            return None
        if event.returncode == 0:
            return if_good
        return OpaqueFunction(function=_fail, args=[f'{what}: exit status {event.returncode}'])

    handler = OnProcessExit(target_action=process, on_exit=choose)
    return RegisterEventHandler(handler, condition=condition)


def _fail(context: LaunchContext, problem: str) -> None:
    # An exception is the one thing that changes launch's exit status.
    raise RuntimeError(problem)
