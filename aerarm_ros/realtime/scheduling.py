"""Real-time settings of a process, with advice for the user if the system refuses one.

Every function returns None on success, otherwise a warning with the consequences for the user. A
robot on a desk therefore also runs without real-time rights.

An arm's matrices are small. Several threads for one matrix only wait for each other: next to a
real-time loop, solving four equations took milliseconds on several threads instead of
microseconds.
"""

import ctypes
import gc
import os
import resource
import struct
import threading
from collections.abc import Collection, MutableMapping
from contextlib import suppress
from functools import cache

THREAD_VARIABLES = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


def use_one_thread(environment: MutableMapping[str, str] = os.environ) -> None:
    """Restrict linear algebra in this process to one thread, unless the user set a number."""
    for name in THREAD_VARIABLES:
        environment.setdefault(name, '1')


_MCL_CURRENT = 1
_MCL_FUTURE = 2
_LATENCY_FILE = '/dev/cpu_dma_latency'
_LIMITS_FILE = '/etc/security/limits.d/realtime.conf'


def set_fifo(priority: int) -> str | None:
    """Run this process with the real-time policy SCHED_FIFO, ahead of all ordinary processes.

    The calling thread gets `priority`, every other existing thread the next lower one; later
    threads inherit their creator's. A real-time priority of the calling thread alone is not
    enough. The middleware's threads deliver its messages, and an ordinary process must not delay a
    thread with the interpreter's or a writer's lock.

    Parameters
    ----------
    priority
        2 to 99; keep below the kernel's interrupt threads (50) unless they were raised.

    Raises
    ------
    ValueError
        If the priority is out of range.
    """
    if not 2 <= priority <= 99:
        raise ValueError(f'SCHED_FIFO priority {priority} must lie in 2 .. 99')
    caller = threading.get_native_id()
    try:
        os.sched_setscheduler(caller, os.SCHED_FIFO, os.sched_param(priority))
        for thread in _threads():
            if thread != caller:
                with suppress(ProcessLookupError):
                    os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority - 1))
    except OSError as error:
        return (
            f'SCHED_FIFO priority {priority} was refused ({error.strerror}), so the loop '
            'competes with every other process. Put the line "@realtime - rtprio 98" into '
            f'{_LIMITS_FILE}, add the user to the group realtime and log in again; in a '
            'container add --cap-add=SYS_NICE.'
        )
    return None


def lock_memory() -> str | None:
    """Keep all present and future memory of this process in RAM."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    advice = (
        f'a page fault can delay a cycle. Put the line "@realtime - memlock unlimited" into '
        f'{_LIMITS_FILE}, add the user to the group realtime and log in again; in a container '
        'add --ulimit memlock=-1.'
    )
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0:
        # The call might succeed now and make a later allocation fail, which is worse than not
        # locking.
        return f'memory was not locked (the limit is {limit} bytes): {advice}'
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        return f'memory was not locked ({os.strerror(ctypes.get_errno())}): {advice}'
    return None


def set_affinity(cpus: Collection[int]) -> str | None:
    """Restrict all present and future threads of this process to the given CPUs."""
    before = os.sched_getaffinity(0)
    _try_affinity(cpus)
    if set(cpus) == os.sched_getaffinity(0):
        return None
    _try_affinity(before)
    return (
        f'CPUs {sorted(cpus)} were refused, so this process stays on {sorted(before)}: check the '
        'CPU numbers, the isolcpus boot option and the cpuset of the container.'
    )


def keep_cpus_awake() -> str | None:
    """Prevent sleep states of idle CPUs while this process runs (PM QoS of the kernel).

    A CPU in an idle state takes 10 to 50 us for every wake-up, several times per cycle. An awake
    CPU needs more power and cooling.
    """
    try:
        _latency_request()
    except OSError as error:
        return (
            f'CPUs may sleep between cycles and delay every wake-up ({_LATENCY_FILE}: '
            f'{error.strerror}). Add the user to the group realtime and put the line '
            '\'KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660"\' into '
            f'/etc/udev/rules.d/99-realtime.rules; in a container add --device={_LATENCY_FILE}.'
        )
    return None


@cache
def _latency_request() -> int:
    """Open the kernel's latency file and request no latency, as long as the file is open."""
    file = os.open(_LATENCY_FILE, os.O_WRONLY)
    os.write(file, struct.pack('=i', 0))
    return file


def freeze_garbage_collector() -> str | None:
    """Run Python's cyclic garbage collector once, then switch it off.

    The collector's pauses grow with the number of objects and occur at any time. Reference
    counting continues, so a loop without reference cycles does not grow.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    return None


def _try_affinity(cpus: Collection[int]) -> None:
    for thread in _threads():
        with suppress(OSError, ValueError, OverflowError):
            os.sched_setaffinity(thread, cpus)


def _threads() -> list[int]:
    """Return the thread ids of this process; a thread may end before its id is used."""
    return [int(name) for name in os.listdir('/proc/self/task')]
