"""End a process together with its parent process.

A parent that is killed (SIGKILL, out of memory) cannot stop its children, but Linux can. Each
command of this package requests it first, if its environment names the parent. Code between fork
and exec (`preexec_fn`) is not suitable, because it may hang if the parent has threads, as with
ROS.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>
# Process id of the launch, or other process, that starts a process: set by
# `aerarm_ros/launch_parts.py` and by `NodeProcess`.
LAUNCH_PID = 'AERARM_ROS_LAUNCH_PID'


def die_with_parent(parent: int) -> None:
    """Request SIGTERM when the thread that started this process ends.

    Parameters
    ----------
    parent
        Expected parent process.

    Raises
    ------
    OSError
        If the system refuses.
    ProcessLookupError
        If `parent` has already ended.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    if os.getppid() != parent:
        raise ProcessLookupError(f'process {parent} has ended')


def die_with_launch() -> None:
    """Request SIGTERM when the launch that started this process ends.

    Launch can end before its processes: by an exception during start, by SIGTERM or SIGQUIT, or if
    it is killed. Without launch in the environment this function does nothing. A grandchild of
    launch is not affected either, because it belongs to its own parent.

    Raises
    ------
    OSError
        If the system refuses.
    SystemExit
        If launch has already ended.
    """
    launch = os.environ.get(LAUNCH_PID, '')
    if not launch.isdigit():
        return
    if os.getppid() == int(launch) or not os.path.exists(f'/proc/{launch}'):
        try:
            die_with_parent(int(launch))
        except ProcessLookupError:
            sys.exit(128 + signal.SIGTERM)
