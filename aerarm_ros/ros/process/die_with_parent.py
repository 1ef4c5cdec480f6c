"""Becomes another program that is ended as soon as its parent process is gone.

Usage: python die_with_parent.py PARENT_PID PROGRAM [ARGUMENT...]

A command of this package that ROS's launch has started does the same for itself: see
`die_with_launch`.

A parent that is killed (SIGKILL, out of memory) cannot stop its children. Linux can: the
signal asked for here stays asked for when this program replaces itself by the other one. It
is asked for after the fork, in a program of its own, because code run between fork and exec
(`preexec_fn`) may hang where the parent has threads, and one with ROS has. Only the standard
library is used, so that Python starts in 20 ms.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>
# Process id of the launch that starts a process; set by `aerarm_ros/launch_parts.py`.
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


if __name__ == '__main__':
    try:
        die_with_parent(int(sys.argv[1]))
    except ProcessLookupError:
        sys.exit(128 + signal.SIGTERM)
    os.execv(sys.argv[2], sys.argv[2:])
