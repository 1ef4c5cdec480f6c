"""Parameters of the hardware bridge."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.frames.frame_profile import FrameProfile, ProfileError, load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.ros.bridge.commissioning_topics import COMMISSIONING_PARAMETER
from aerarm_ros.ros.parameters.parameter_table import Parameter
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE, REAL_TIME_PARAMETERS

_DEFAULTS = BridgeSettings()
AUTO = 'auto'
"""Value of `state_file` that leaves the place to the bridge."""

# Name: (unit, description) of the settings that the bridge cycle takes as they are.
_SETTINGS = {
    'command_timeout': ('s', 'age of the last accepted command at which the arm is damped'),
    'stamp_age_max': ('s', 'largest age of the state that a command answers'),
    'board_timeout': (
        's',
        'time without a valid frame after which a board switches its motors off',
    ),
    'bad_frames_max': ('', 'consecutive bad frames of a board that are a fault'),
    'lost_commands_max': (
        '',
        'consecutive commands that do not reach a board, while its answers arrive, that are a '
        'fault',
    ),
    'lost_commands_warning': (
        '',
        'share of such commands, over the last second, that is a warning',
    ),
    'state_age_max': ('s', "time for which a board's data may stay the same, frame after frame"),
    'exchange_time_max': ('s', 'duration of an exchange that counts as slow'),
    'slow_exchanges_max': ('', 'consecutive slow exchanges that are a fault'),
    'connect_frames': ('', 'consecutive good frames after which a board counts as connected'),
    'alignment_timeout': ('s', 'longest time a board may take to align its motors'),
    'soft_zone': (
        'rad',
        'distance from a position limit over which motion towards it is slowed, if not before',
    ),
    'position_tolerance': ('rad', 'distance beyond a position limit at which the arm is stopped'),
    'velocity_factor': ('', 'multiple of the velocity limits at which the arm is stopped'),
    'effort_factor': ('', 'multiple of the effort limits at which the arm is stopped'),
    'position_error_max': ('rad', 'distance of a reference from the arm at which it is stopped'),
    'velocity_lag': ('s', "time constant of the boards' low-pass of the motors' speeds"),
    'current_lag': ('s', "time constant of the boards' current loop, for the mean torque"),
    'stall_time': ('s', 'standstill under a torque that must move the joint that is a fault'),
    'ambient_temperature': ('degC', 'temperature of the air about the motors'),
    'start_temperature': (
        'degC',
        'assumed temperature of the motors when the bridge starts; that of the air for cold motors',
    ),
}

BRIDGE_PARAMETERS = (
    *ARM_FILES,
    DRONE_FILE,
    Parameter(
        'period', _DEFAULTS.period, 'time between two cycles', 's', *BridgeSettings.BOUNDS['period']
    ),
    COMMISSIONING_PARAMETER,
    Parameter('autostart', True, 'configure and activate by itself, without a lifecycle manager'),
    *REAL_TIME_PARAMETERS,
    Parameter(
        'cpus',
        [],
        'CPUs the process may run on; all if empty',
        element=int,
        minimum=0,
        maximum=1023,
    ),
    Parameter('freeze_gc', True, "switch Python's cyclic garbage collector off while active"),
    Parameter(
        'allowed_publishers',
        [],
        'names of the nodes that may publish joint_command; any if empty',
    ),
    Parameter('profile', '', "frames of the boards, name or file; the configuration's if empty"),
    Parameter(
        'profile_scales',
        [],
        'scales that differ from the profile, as QUANTITY=VALUE_OF_ONE_COUNT, such as '
        'bus_voltage=0.001',
    ),
    Parameter(
        'state_file',
        AUTO,
        "file that keeps the encoders' zeros while the bridge restarts and the boards stay on; "
        'auto: with real boards aerarm_ros/NODE.json in $XDG_STATE_HOME (~/.local/state), none '
        'with emulated ones; none if empty',
    ),
    *(
        Parameter(
            name,
            [],
            f"{what} of the boards' law (4.4), motor side: one, or one a joint; the "
            "configuration's if empty",
            unit,
            minimum=0.0,
            maximum=maximum,
            live=True,
            element=float,
            group="The boards' gains",
        )
        # What a profile's fields hold is less, and is checked when they are set.
        for name, what, unit, maximum in (
            ('board_kp', 'stiffness', 'A/rad', 100.0),
            ('board_kd', 'damping, at least what slows a falling arm,', 'A s/rad', 10.0),
            ('board_ki', 'integral gain, where the profile carries it,', 'A/(rad s)', 1000.0),
        )
    ),
    *(
        Parameter(
            name,
            getattr(_DEFAULTS, name),
            description,
            unit,
            *BridgeSettings.BOUNDS[name],
            group='When the bridge slows, damps or stops',
        )
        for name, (unit, description) in _SETTINGS.items()
    ),
)


def bridge_settings(values: SimpleNamespace) -> BridgeSettings:
    """Return the cycle's settings out of a node's parameter values."""
    return BridgeSettings(**{name: getattr(values, name) for name in ('period', *_SETTINGS)})


def state_file(values: SimpleNamespace, node: str, emulated: bool) -> Path | None:
    """Return the file that keeps the zeros of the bridge of a full name, None if there is none.

    Raises ValueError if the user has no home directory to put it.
    """
    if values.state_file != AUTO:
        return Path(values.state_file) if values.state_file else None
    if emulated:
        return None
    try:
        folder = os.environ.get('XDG_STATE_HOME') or Path.home() / '.local' / 'state'
    except RuntimeError:
        raise ValueError(
            "there is no home directory for the encoders' zeros: give state_file, or XDG_STATE_HOME"
        ) from None
    return Path(folder) / 'aerarm_ros' / f'{node.strip("/").replace("/", ".")}.json'


def frame_profile(values: SimpleNamespace, config: ArmConfig) -> FrameProfile:
    """Return the boards' frames; raises ProfileError with what to check."""
    profile = load_profile(values.profile or config.profile)
    for entry in values.profile_scales:
        name, _, lsb = entry.partition('=')
        try:
            profile = profile.with_lsb(name.strip(), float(lsb))
        except ProfileError as error:
            raise ProfileError(f'parameter profile_scales: {error}') from None
        except ValueError:
            raise ProfileError(
                f'parameter profile_scales: {entry!r} is not of the form QUANTITY=NUMBER'
            ) from None
    return profile


def board_gains(
    values: Mapping[str, Any], config: ArmConfig
) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
    """Return kp, kd and integral gain out of parameter values, empty ones filled in."""
    return (
        values['board_kp'] or config.column('board_kp'),
        values['board_kd'] or config.column('board_kd'),
        values['board_ki'] or 0.0,
    )
