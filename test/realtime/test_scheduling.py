"""Each real-time request in a separate process, granted and refused."""

import os
import subprocess
import sys

import pytest

from aerarm_ros.realtime import scheduling

# Drops all rights, as an ordinary user on an untuned machine has them.
_ORDINARY_USER = """
import os, resource
for kind, limit in ((resource.RLIMIT_RTPRIO, 0), (resource.RLIMIT_MEMLOCK, 65536)):
    resource.setrlimit(kind, (limit, limit))
if os.geteuid() == 0:
    os.setresgid(65534, 65534, 65534)
    os.setresuid(65534, 65534, 65534)
"""
_IMPORT = 'import gc, os\nfrom aerarm_ros.realtime import scheduling\n'


def run(code: str) -> str:
    return subprocess.run(
        [sys.executable, '-c', code], check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.mark.parametrize(
    ('request_', 'refused', 'advice'),
    [
        ('set_fifo(50)', 'SCHED_FIFO priority 50 was refused', 'rtprio'),
        ('lock_memory()', 'memory was not locked', 'memlock unlimited'),
        ('keep_cpus_awake()', 'CPUs may sleep between cycles', 'KERNEL=="cpu_dma_latency"'),
    ],
)
def test_an_ordinary_user_gets_advice_instead(request_: str, refused: str, advice: str) -> None:
    said = run(f'{_IMPORT}{_ORDINARY_USER}print(scheduling.{request_})')
    assert refused in said
    assert advice in said


@pytest.mark.skipif(
    not os.access('/dev/cpu_dma_latency', os.W_OK), reason='/dev/cpu_dma_latency is not writable'
)
def test_cpus_stay_awake_as_long_as_the_process_lives() -> None:
    read = "struct.unpack('=i', open('/dev/cpu_dma_latency', 'rb').read(4))[0]"
    code = (
        f'{_IMPORT}import struct\nprint(scheduling.keep_cpus_awake(), {read})\n'
        'before = os.listdir("/proc/self/fd")\n'
        'print(scheduling.keep_cpus_awake(), os.listdir("/proc/self/fd") == before)'
    )
    assert run(code) == 'None 0\nNone True'


def test_a_cpu_that_is_not_there_is_refused_and_nothing_changes() -> None:
    said = run(
        f'{_IMPORT}before = os.sched_getaffinity(0)\n'
        'print(scheduling.set_affinity([0, 100_000]), scheduling.set_affinity([]))\n'
        'assert os.sched_getaffinity(0) == before'
    )
    assert '[0, 100000] were refused' in said
    assert 'CPUs [] were refused' in said


# A second thread that was there before; all(...) of what a function says of every thread.
_THREAD = """
import threading
threading.Thread(target=threading.Event().wait, daemon=True).start()
def each(function):
    return sorted(map(function, map(int, os.listdir('/proc/self/task'))))
"""


def _may_use_fifo() -> bool:
    code = 'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))'
    return subprocess.run([sys.executable, '-c', code], capture_output=True).returncode == 0


@pytest.mark.skipif(not _may_use_fifo(), reason='this user may not use SCHED_FIFO')
def test_fifo_is_granted_to_the_loop_and_one_below_it_to_the_others() -> None:
    code = (
        f'{_IMPORT}{_THREAD}print(scheduling.set_fifo(7), os.sched_getparam(0).sched_priority, '
        'each(os.sched_getscheduler) == [os.SCHED_FIFO] * 2, '
        'each(lambda thread: os.sched_getparam(thread).sched_priority))'
    )
    assert run(code) == 'None 7 True [6, 7]'


def test_a_priority_out_of_range_is_a_mistake() -> None:
    for priority in (1, 100, -5):
        with pytest.raises(ValueError, match='must lie in 2 .. 99'):
            scheduling.set_fifo(priority)


def test_one_cpu_is_granted_to_all_threads_and_the_garbage_collector_stays_off() -> None:
    code = (
        f'{_IMPORT}{_THREAD}cpu = min(os.sched_getaffinity(0))\n'
        'print(scheduling.set_affinity([cpu]), each(os.sched_getaffinity) == [{cpu}] * 2)\n'
        'print(scheduling.freeze_garbage_collector(), gc.isenabled(), gc.get_freeze_count() > 0)\n'
        'warning = scheduling.lock_memory()\n'
        'locked = [x for x in open("/proc/self/status") if x.startswith("VmLck")][0].split()[1]\n'
        'print(warning is not None or int(locked) > 0)'
    )
    assert run(code) == 'None True\nNone False True\nTrue'
