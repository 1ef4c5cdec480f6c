"""Where ROS writes its logs."""

from __future__ import annotations

import os
import tempfile
from collections.abc import MutableMapping
from pwd import getpwuid

# The first of these that is set tells ROS where, and without any it does not start.
_CHOICES = ('ROS_LOG_DIR', 'ROS_HOME', 'HOME')


def find_log_directory(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let ROS log where it does by default, or else among temporary files.

    Schedulers and service managers start programs without HOME. To be called before `rclpy.init`.

    Parameters
    ----------
    environment
        Of this process, or of one to be started.
    """
    if any(environment.get(name) for name in _CHOICES):
        return
    home = _home_of_this_user()
    if home is not None:
        environment['HOME'] = home
    else:
        environment['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='aerarm_ros_log_')


def _home_of_this_user() -> str | None:
    """Return the home directory that the system knows of, None without one."""
    try:
        home = getpwuid(os.getuid()).pw_dir
    except KeyError:
        return None
    return home if os.access(home, os.W_OK) else None
