"""ROS parameters of the bridge, and their conversion to settings."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from dataclasses import Field, fields
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.board_link import Transport
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.ros.bridge.commissioning_topics import COMMISSIONING_PARAMETER
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE, REAL_TIME_PARAMETERS

AUTO = 'auto'
"""Value of the parameter `state_file` that selects the default path."""

_PERIOD, *_LIMITS = fields(BridgeSettings)


def _parameter(setting: Field[Any], group: str = '') -> Parameter:
    """Return the parameter of a setting of the bridge."""
    about = setting.metadata
    default: Any = setting.default
    low, high = about['bounds']
    text, unit = about['description'], about['unit']
    return Parameter(setting.name, default, text, unit, low, high, group=group)


TRANSPORT = Parameter(
    'transport',
    'spidev',
    'connection to the motor boards: spidev, or the import path of a Python module with the '
    'function make_transport',
)

BRIDGE_PARAMETERS = (
    *ARM_FILES,
    DRONE_FILE,
    _parameter(_PERIOD),
    COMMISSIONING_PARAMETER,
    Parameter(
        'autostart',
        True,
        'whether the bridge configures and activates itself at its start, without a lifecycle '
        'manager',
    ),
    *REAL_TIME_PARAMETERS,
    Parameter(
        'cpus',
        [],
        'numbers of the CPUs on which the process may run; all if empty',
        element=int,
        minimum=0,
        maximum=1023,
    ),
    Parameter(
        'freeze_gc',
        True,
        "whether Python's cyclic garbage collector is off while the bridge is active",
    ),
    Parameter(
        'allowed_publishers',
        [],
        'names of the nodes whose joint commands the bridge accepts; all nodes if empty',
    ),
    Parameter(
        'profile',
        '',
        'name or file of the board profile, which describes the frames; if empty, that of the '
        'configuration',
    ),
    TRANSPORT,
    Parameter(
        'state_file',
        AUTO,
        'file with the encoder zeros, for a restart of the bridge while the boards stay on; no '
        "file if empty. 'auto' is aerarm_ros/NODE.json in $XDG_STATE_HOME (~/.local/state) with "
        'real boards, and no file with emulated boards',
    ),
    *(
        Parameter(
            name,
            [],
            f"{what} of the boards' control law, thesis (4.4), on the motor side, one value or one "
            'per joint; if empty, that of the configuration',
            unit,
            minimum=0.0,
            maximum=maximum,
            live=True,
            element=float,
            group='Gains of the boards',
        )
        # The fields of a frame profile have smaller ranges, which are checked when they are set.
        for name, what, unit, maximum in (
            ('board_kp', 'position gain', 'A/rad', 100.0),
            ('board_kd', 'velocity gain (large enough to slow a falling arm)', 'A s/rad', 10.0),
            ('board_ki', 'integral gain (if the board profile has one)', 'A/(rad s)', 1000.0),
        )
    ),
    *(
        _parameter(setting, 'Limits at which the bridge slows, damps or stops the arm')
        for setting in _LIMITS
    ),
)


_METHODS = [name for name in vars(Transport) if not name.startswith('_')]


def make_transport(name: str, config: ArmConfig) -> Transport:
    """Return the transport of a module in `hardware/transports`, or of a user's module.

    Raises ValueError if there is no such module, or if its function `make_transport` fails or
    returns no `Transport`.
    """
    own = f'aerarm_ros.hardware.transports.{name}_transport'
    try:
        module = importlib.import_module(own if name.isidentifier() and find_spec(own) else name)
        transport: Transport = module.make_transport(config)
        missing = [method for method in _METHODS if not hasattr(transport, method)]
        if missing:
            raise TypeError(f'the transport has no method {", ".join(missing)}')
    except OSError:
        raise  # a connection that cannot be made has its own message
    except Exception as error:  # whatever a user's module raises
        raise ValueError(
            f'the parameter transport is {name!r}, but this module cannot be used '
            f"({type(error).__name__}: {error}): set transport to 'spidev', or to the import path "
            'of a module whose function make_transport returns a Transport'
        ) from None
    return transport


def bridge_settings(values: SimpleNamespace) -> BridgeSettings:
    """Convert the node's parameters to the settings of the bridge's cycle."""
    return BridgeSettings(
        **{name: getattr(values, name) for name in BridgeSettings.__dataclass_fields__}
    )


def state_file(values: SimpleNamespace, node: str, emulated: bool) -> Path | None:
    """Return the path of the file in which the bridge stores the encoder zeros, or None.

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
            'this user has no home directory for the file with the encoder zeros: set the '
            'parameter state_file, or the environment variable XDG_STATE_HOME'
        ) from None
    return Path(folder) / 'aerarm_ros' / f'{node.strip("/").replace("/", ".")}.json'


def board_gains(
    values: Mapping[str, Any], config: ArmConfig
) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
    """Return the boards' gains kp, kd and ki; empty parameters default to the configuration."""
    return (
        values['board_kp'] or config.column('board_kp'),
        values['board_kd'] or config.column('board_kd'),
        values['board_ki'] or 0.0,
    )
