"""Discovery of Fast DDS: the packaged profile, and staying on this host."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, MutableMapping
from pathlib import Path

from aerarm_ros.description.resources import resource

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


# Read by Fast DDS when a process's first participant is made; other middleware ignores it.
PROFILES_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_EVERYWHERE, _LOOPBACK = 'fastdds.xml', 'fastdds_loopback.xml'


def use_packaged_profile(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS use a packaged profile, unless the environment names another.

    With it a new node is announced often enough that nodes find each other in a fraction of a
    second, not sometimes in three. Where nodes are to be found from this host only, it listens
    on no other interface. To be called before `rclpy.init`, and after `stay_on_this_host`.

    Parameters
    ----------
    environment
        Of this process, or of one to be started.

    Raises
    ------
    FileNotFoundError
        If the package's files are not installed.
    """
    profiles = {name: resource('config', name) for name in (_EVERYWHERE, _LOOPBACK)}
    named = environment.get(PROFILES_FILE)
    # A parent process, or the user, may have chosen one of ours for another discovery range.
    if not named or _content(Path(named)) in map(_content, profiles.values()):
        name = _LOOPBACK if is_on_this_host(environment) else _EVERYWHERE
        environment[PROFILES_FILE] = str(profiles[name])


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
