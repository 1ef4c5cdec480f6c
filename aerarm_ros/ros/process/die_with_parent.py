"""The end of a process with the process that started it.

A parent that is killed (SIGKILL, out of memory) cannot stop its children. Linux can. Each command
of this package asks for that as the first thing it does, if its environment names the parent: code
run between fork and exec (`preexec_fn`) may hang where a parent has threads, as one with ROS has.
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
    """Ask for SIGTERM when the thread that started this process ends.

    Parameters
    ----------
    parent
        Process that should be the parent.

    Raises
    ------
    OSError
        If the system refuses.
    ProcessLookupError
        If `parent` has ended already.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    if os.getppid() != parent:
        raise ProcessLookupError(f'process {parent} has ended')


def die_with_launch() -> None:
    """End with SIGTERM when the launch that started this process is gone.

    Launch can end before what it started: by an exception while it still starts others, by
    SIGTERM or SIGQUIT, killed. Without launch in the environment nothing is asked for, and neither
    for a process that one started by launch has started: it belongs to that one.

    Raises
    ------
    OSError
        If the system refuses.
    SystemExit
        If launch has gone already.
    """
    launch = os.environ.get(LAUNCH_PID, '')
    if not launch.isdigit():
        return
    if os.getppid() == int(launch) or not os.path.exists(f'/proc/{launch}'):
        try:
            die_with_parent(int(launch))
        except ProcessLookupError:
            sys.exit(128 + signal.SIGTERM)
