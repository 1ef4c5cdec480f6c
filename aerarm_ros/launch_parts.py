"""Arguments, parameters and actions that several launch files use.

Only launch files import this module, because ROS's launch is not installed on every computer.
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
# Exit status that asyncio reports if it missed the end of a process.
_UNKNOWN = 255
ON_SPI = EqualsSubstitution(LaunchConfiguration('hardware'), 'spi')
IMU_REMAPPING = ('imu', LaunchConfiguration('imu_topic'))


def switch_argument(
    name: str, description: str, default: SomeSubstitutionsType = 'false'
) -> DeclareLaunchArgument:
    """Return a launch argument that accepts only the values true and false."""
    return DeclareLaunchArgument(
        name, default_value=default, choices=['true', 'false'], description=description
    )


def drone_argument() -> DeclareLaunchArgument:
    """Return the launch argument that names the drone file."""
    return DeclareLaunchArgument(
        'drone_file',
        default_value='',
        description='YAML file of the drone that carries the arm, for example config/drone.yaml; '
        'no drone if empty',
    )


def drone_parameter() -> dict[str, ParameterValue]:
    """Return the node parameter `drone_file` as a string, even if the launch argument is empty."""
    return {'drone_file': ParameterValue(LaunchConfiguration('drone_file'), value_type=str)}


def arm_parameters(
    *others: str, urdf: SomeSubstitutionsType | None = None
) -> dict[str, SomeSubstitutionsType | ParameterValue]:
    """Return node parameters: configuration file and URDF of the arm, `tf_prefix`, and `others`.

    Parameters
    ----------
    others
        Names of further parameters, which launch arguments of the same names set.
    urdf
        URDF to use instead of the value of the launch argument `urdf`.
    """
    prefix = ParameterValue(LaunchConfiguration('tf_prefix'), value_type=str)
    given = {**arguments_as_parameters('config', 'urdf', *others), 'tf_prefix': prefix}
    return given if urdf is None else {**given, 'urdf': urdf}


def enable_argument(default: SomeSubstitutionsType = 'false') -> DeclareLaunchArgument:
    """Return the launch argument `enable`, which switches the motors on."""
    what = (
        'switch the motors on as soon as the motor boards respond, and home the arm if encoder '
        'zeros are unknown: THE ARM MOVES, and must start in its home configuration'
    )
    return switch_argument('enable', what, default)


def controller_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the launch argument `controller`, which selects the controller to start."""
    return DeclareLaunchArgument(
        'controller',
        default_value=default,
        choices=['none', *controllers()],
        description='name of the controller to start; none for no controller',
    )


def base_motion_argument(default: str = 'none') -> DeclareLaunchArgument:
    """Return the launch argument `base_motion`: how a controller obtains the arm's base motion."""
    return DeclareLaunchArgument(
        'base_motion',
        default_value=default,
        choices=['none', 'attitude', 'full', 'free'],
        description="motion of the arm's base that the controller assumes: none (fixed base), "
        'attitude (tilt from the IMU), full (tilt and acceleration from the IMU), or free '
        '(predicted for the drone in drone_file)',
    )


# For launch files that move the arm without a controller. Only emulated motors are switched on
# automatically. No controller can be selected, because two nodes must not command the arm.
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
        description='always none, because another node of this launch file commands the arm',
    ),
    DeclareLaunchArgument(
        'excitation_config',
        default_value=PathJoinSubstitution([SHARE, 'config', 'excitation.yaml']),
        description='YAML file with clearances, and with the fraction of each joint limit that '
        'motions may use',
    ),
)


def check_first(*packages: str) -> OpaqueFunction:
    """Return an action that checks files, packages and modules before any process starts.

    The action replaces the name of a packaged file by its path. All processes that start afterwards
    end together with launch, even if launch is killed.

    Parameters
    ----------
    packages
        ROS packages that the launch file needs for all arguments.
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
    """Install an empty Python handler for SIGINT, so that only launch's event loop handles SIGINT.

    Launch reads signals from its wakeup file descriptor, but keeps Python's own handler. This
    handler raises KeyboardInterrupt in a task of launch. Launch then waits for this task for ever,
    or misses the end of a process. If SIGINT is ignored, as in a background job of a script, Python
    writes nothing to the descriptor.
    """
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, signal.SIG_IGN):
        signal.signal(signal.SIGINT, lambda number, frame: None)


def bringup() -> IncludeLaunchDescription:
    """Return an action that includes bringup.launch.py with the present launch arguments."""
    return IncludeLaunchDescription(PathJoinSubstitution([SHARE, 'launch', 'bringup.launch.py']))


def node(
    executable: SomeSubstitutionsType, parameters: Mapping[str, Any] | None = None, **options: Any
) -> Node:
    """Return a node of this package; `parameters` override the values of the parameter file.

    Launch sends SIGTERM to a node that has not ended `sigterm_timeout` [s] after SIGINT. The
    default of launch, 5 s, is too short for a recorder that completes its bag on a busy computer.
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
    """Return node parameters that have the names and values of launch arguments."""
    return {name: LaunchConfiguration(name) for name in names}


def end(reason: str) -> EmitEvent:
    """Return an action that ends launch with exit status 0."""
    return EmitEvent(event=Shutdown(reason=reason))


def after(
    process: Action, what: str, if_good: Action | None = None, condition: Condition | None = None
) -> RegisterEventHandler:
    """Return a handler: run `if_good` if `process` succeeds, otherwise end launch with status 1.

    While launch shuts down, a stopped process counts as successful. A process with exit status 255
    then also counts as successful, because asyncio reports 255 if Ctrl-C interrupts the waiting.
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
    # Launch has no other way to set its exit status than an exception.
    raise RuntimeError(problem)
