"""Who can find the nodes of this package."""

from __future__ import annotations

import os
from collections.abc import Mapping

_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
# Whoever sets one of these has decided.
_CHOICES = (_RANGE, 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY', 'ROS_DISCOVERY_SERVER')


def stay_on_this_host() -> None:
    """Let nodes be found from this host only, unless the environment says otherwise.

    ROS 2 announces nodes to the whole network by default, where anybody may then command the
    arm. To be called before `rclpy.init`.
    """
    if not any(os.environ.get(name) for name in _CHOICES):
        os.environ[_RANGE] = 'LOCALHOST'


def is_on_this_host(environment: Mapping[str, str] = os.environ) -> bool:
    """Tell whether an environment lets nodes be found from this host, and from nowhere else."""
    if environment.get('ROS_STATIC_PEERS') or environment.get('ROS_DISCOVERY_SERVER'):
        return False
    return (
        environment.get(_RANGE, '').upper() == 'LOCALHOST'
        or environment.get('ROS_LOCALHOST_ONLY') == '1'
    )
