"""Who can find the nodes of this package."""

from __future__ import annotations

import os
import socket
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


def is_domain_free(domain: int) -> bool:
    """Tell whether no node on this host seems to be in a ROS domain of 0 to 101.

    The first one in a domain has its discovery port (RTPS 2.2, 9.6.1.1).
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', 7400 + 250 * domain + 10))
        except OSError:
            return False
    return True
