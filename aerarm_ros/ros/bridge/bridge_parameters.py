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
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE, REAL_TIME_PARAMETERS

_DEFAULTS = BridgeSettings()
AUTO = 'auto'
"""Value of `state_file` with which the bridge selects the path."""

# Name: (unit, description) of the settings that `BridgeSettings` accepts unchanged.
_SETTINGS = {
    'command_timeout': ('s', 'age of the last accepted command at which the bridge damps the arm'),
    'stamp_age_max': ('s', 'largest age of the state that a command responds to'),
    'board_timeout': (
        's',
        'time without a valid frame after which a board switches its motors off',
    ),
    'bad_frames_max': ('', 'number of consecutive bad frames of a board that causes a fault'),
    'lost_commands_max': (
        '',
        'number of consecutive lost commands, to a board that still sends frames, that causes a '
        'fault',
    ),
    'lost_commands_warning': (
        '',
        'fraction of lost commands over the last second that causes a warning',
    ),
    'state_age_max': ('s', "longest time during which a board's data may stay unchanged"),
    'exchange_time_max': ('s', 'duration above which an exchange counts as slow'),
    'slow_exchanges_max': ('', 'number of consecutive slow exchanges that causes a fault'),
    'connect_frames': (
        '',
        ('number of consecutive good frames after which a board counts as connected'),
    ),
    'alignment_timeout': ('s', "time limit for the alignment of a board's motors"),
    'soft_zone': (
        'rad',
        'distance from a position limit below which the bridge slows motion towards it',
    ),
    'position_tolerance': (
        'rad',
        'distance beyond a position limit at which the bridge stops the arm',
    ),
    'velocity_factor': ('', 'multiple of the velocity limits at which the bridge stops the arm'),
    'effort_factor': ('', 'multiple of the effort limits at which the bridge stops the arm'),
    'position_error_max': (
        'rad',
        'distance of a position reference from the joint position at which the bridge stops the '
        'arm',
    ),
    'velocity_lag': ('s', "time constant of the boards' velocity low-pass"),
    'current_lag': ('s', "time constant of the boards' current loop, for the mean torque"),
    'stall_time': (
        's',
        'duration of standstill, under a torque that must move the joint, that causes a fault',
    ),
    'ambient_temperature': ('degC', 'ambient temperature of the motors'),
    'start_temperature': (
        'degC',
        'initial motor temperature of the thermal model; the ambient temperature for cold motors',
    ),
}

BRIDGE_PARAMETERS = (
    *ARM_FILES,
    DRONE_FILE,
    Parameter(
        'period', _DEFAULTS.period, 'time between two cycles', 's', *BridgeSettings.BOUNDS['period']
    ),
    COMMISSIONING_PARAMETER,
    Parameter('autostart', True, 'configure and activate on start, without a lifecycle manager'),
    *REAL_TIME_PARAMETERS,
    Parameter(
        'cpus',
        [],
        'CPUs the process may run on; all if empty',
        element=int,
        minimum=0,
        maximum=1023,
    ),
    Parameter('freeze_gc', True, "switch off Python's cyclic garbage collector while active"),
    Parameter(
        'allowed_publishers',
        [],
        'names of the nodes that may publish joint_command; any if empty',
    ),
    Parameter(
        'profile', '', 'frame profile of the boards, name or file; as in the configuration if empty'
    ),
    Parameter(
        'profile_scales',
        [],
        'scales that differ from the profile, as QUANTITY=VALUE_OF_ONE_COUNT, for example '
        'bus_voltage=0.001',
    ),
    Parameter(
        'state_file',
        AUTO,
        'file that keeps the encoder zeros while the bridge restarts and the boards stay on; '
        "none if empty. 'auto': aerarm_ros/NODE.json in $XDG_STATE_HOME (~/.local/state) with "
        'real boards, none with emulated boards',
    ),
    *(
        Parameter(
            name,
            [],
            f"{what} of the boards' control law (4.4), motor side, one value or one per joint; "
            'as in the configuration if empty',
            unit,
            minimum=0.0,
            maximum=maximum,
            live=True,
            element=float,
            group='Gains of the boards',
        )
        # The fields of a frame profile have smaller ranges, which are checked when they are set.
        for name, what, unit, maximum in (
            ('board_kp', 'stiffness', 'A/rad', 100.0),
            ('board_kd', 'damping (must be sufficient to slow a falling arm)', 'A s/rad', 10.0),
            (
                'board_ki',
                'integral gain (only if the frame profile has this field)',
                'A/(rad s)',
                1000.0,
            ),
        )
    ),
    *(
        Parameter(
            name,
            getattr(_DEFAULTS, name),
            description,
            unit,
            *BridgeSettings.BOUNDS[name],
            group='Limits for slowing, damping and stopping',
        )
        for name, (unit, description) in _SETTINGS.items()
    ),
)


def bridge_settings(values: SimpleNamespace) -> BridgeSettings:
    """Return the settings of the bridge's cycle from the node's parameters."""
    return BridgeSettings(**{name: getattr(values, name) for name in ('period', *_SETTINGS)})


def state_file(values: SimpleNamespace, node: str, emulated: bool) -> Path | None:
    """Return the file in which a bridge stores the joints' zeros, or None without such a file.

    Raises ValueError if the user has no home directory for the file.
    """
    if values.state_file != AUTO:
        return Path(values.state_file) if values.state_file else None
    if emulated:
        return None
    try:
        folder = os.environ.get('XDG_STATE_HOME') or Path.home() / '.local' / 'state'
    except RuntimeError:
        raise ValueError(
            'no home directory for the encoder zeros: set state_file, or XDG_STATE_HOME'
        ) from None
    return Path(folder) / 'aerarm_ros' / f'{node.strip("/").replace("/", ".")}.json'


def frame_profile(values: SimpleNamespace, config: ArmConfig) -> FrameProfile:
    """Return the layout of the boards' frames; raises ProfileError."""
    profile = load_profile(values.profile or config.profile)
    for entry in values.profile_scales:
        name, _, lsb = entry.partition('=')
        try:
            profile = profile.with_lsb(name.strip(), float(lsb))
        except ProfileError as error:
            raise ProfileError(f'parameter profile_scales: {error}') from None
        except ValueError:
            raise ProfileError(
                f'{entry!r} in parameter profile_scales must have the form QUANTITY=NUMBER'
            ) from None
    return profile


def board_gains(
    values: Mapping[str, Any], config: ArmConfig
) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
    """Return kp, kd and integral gain from the parameters, with defaults for empty ones."""
    return (
        values['board_kp'] or config.column('board_kp'),
        values['board_kd'] or config.column('board_kd'),
        values['board_ki'] or 0.0,
    )
