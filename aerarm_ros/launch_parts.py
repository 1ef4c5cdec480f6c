"""Launch arguments, parameters and actions that several launch files use.

Only launch files import this module, because not every host has ROS's launch.
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
from aerarm_ros.ros.process.node_process import STOP_TIMEOUT
from aerarm_ros.ros.process.process_end import INTERRUPTED, LAUNCH_PID

SHARE = FindPackageShare('aerarm_ros')
WAIT_FOR_A_PERSON = 600.0  # [s]
# Exit status that asyncio's child watcher reports if it missed the end of a process.
_UNKNOWN = 255
ON_SPI = EqualsSubstitution(LaunchConfiguration('hardware'), 'spi')
IMU_REMAPPING = ('imu', LaunchConfiguration('imu_topic'))


def switch_argument(
    name: str, description: str, default: SomeSubstitutionsType = 'false'
) -> DeclareLaunchArgument:
    """Return a launch argument whose value is true or false."""
    return DeclareLaunchArgument(
        name, default_value=default, choices=['true', 'false'], description=description
    )


def drone_argument() -> DeclareLaunchArgument:
    """Return the launch argument that names the drone file."""
    return DeclareLaunchArgument(
        'drone_file',
        default_value='',
        description='drone that carries the arm, for example config/drone.yaml; no drone if empty',
    )


def drone_parameter() -> dict[str, ParameterValue]:
    """Return the node parameter `drone_file` as a string, even if the string is empty."""
    return {'drone_file': ParameterValue(LaunchConfiguration('drone_file'), value_type=str)}


def arm_parameters(
    *others: str, urdf: SomeSubstitutionsType | None = None
) -> dict[str, SomeSubstitutionsType | ParameterValue]:
    """Return node parameters that describe the arm, plus those of further launch arguments.

    Parameters
    ----------
    others
        Launch arguments that set parameters of the same name.
    urdf
        URDF that replaces the launch argument `urdf`.
    """
    prefix = ParameterValue(LaunchConfiguration('tf_prefix'), value_type=str)
    given = {**arguments_as_parameters('config', 'urdf', *others), 'tf_prefix': prefix}
    return given if urdf is None else {**given, 'urdf': urdf}


def enable_argument(default: SomeSubstitutionsType = 'false') -> DeclareLaunchArgument:
    """Return the launch argument that enables the motors."""
    what = (
        'switch the motors on once the boards respond, and home an arm with unknown zeros: THE '
        'ARM MOVES, from its home configuration'
    )
    return switch_argument('enable', what, default)


def controller_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the launch argument that selects the controller."""
    return DeclareLaunchArgument(
        'controller',
        default_value=default,
        choices=['none', *controllers()],
        description='controller to run',
    )


def base_motion_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the launch argument that selects the base motion for the controller."""
    return DeclareLaunchArgument(
        'base_motion',
        default_value=default,
        choices=['none', 'attitude', 'full', 'free'],
        description='motion of the base that the controller uses: none; attitude or full, both '
        'from the IMU; free, predicted with the drone in drone_file',
    )


# For launch files that move the arm without a controller. Only emulated motors are enabled
# automatically. A controller cannot be selected, because two nodes must not command the arm.
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
        description='fixed to none, because the programs of this launch file command the arm',
    ),
    DeclareLaunchArgument(
        'excitation_config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'excitation.yaml']),
        description='YAML file of obstacles, and of the fractions of the limits that the motion '
        'may use',
    ),
)


def check_first(*packages: str) -> OpaqueFunction:
    """Return the launch action that checks all requirements before any process starts.

    The action replaces the name of a packaged file by its path. Every process that starts
    afterwards ends when launch ends, even if launch is killed.

    Parameters
    ----------
    packages
        ROS packages that the launch file always needs.
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
    """Make Python ignore SIGINT, which launch's event loop handles.

    Launch reads signals from its wakeup file descriptor but keeps Python's own handler. Python's
    handler raises KeyboardInterrupt in any task of launch. Launch then waits for that task for
    ever, or misses the end of a process. A process that ignores SIGINT, such as a background job
    of a script, writes nothing to the descriptor.
    """
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, signal.SIG_IGN):
        signal.signal(signal.SIGINT, lambda number, frame: None)


def bringup() -> IncludeLaunchDescription:
    """Return the action that includes bringup.launch.py with the arguments set so far."""
    return IncludeLaunchDescription(PathJoinSubstitution([SHARE, 'launch', 'bringup.launch.py']))


def node(
    executable: SomeSubstitutionsType, parameters: Mapping[str, Any] | None = None, **options: Any
) -> Node:
    """Return a node with the values of the parameter file, overridden by `parameters`.

    After `sigterm_timeout` [s] launch sends a second signal, which ends a node at once. The
    default of 5 s is too short for a recorder that completes its bag on a busy host.
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
    """Return node parameters whose values are those of launch arguments of the same name."""
    return {name: LaunchConfiguration(name) for name in names}


def end(reason: str) -> EmitEvent:
    """Return the launch action that shuts launch down with exit status 0."""
    return EmitEvent(event=Shutdown(reason=reason))


def after(
    process: Action, what: str, if_good: Action | None = None, condition: Condition | None = None
) -> RegisterEventHandler:
    """Run an action after a process succeeds; if the process fails, launch exits with status 1.

    A process that is stopped while launch shuts down has not failed. Exit status 255 is not a
    failure either: asyncio reports it if a Ctrl-C interrupts the task that awaits the process.
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
    # Only an exception changes launch's exit status.
    raise RuntimeError(problem)
