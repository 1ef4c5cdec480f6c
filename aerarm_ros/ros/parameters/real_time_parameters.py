"""What a node with a loop asks of the operating system, by its parameters."""

from __future__ import annotations

from types import SimpleNamespace

from rclpy.impl.rcutils_logger import RcutilsLogger

from aerarm_ros.realtime.scheduling import (
    freeze_garbage_collector,
    keep_cpus_awake,
    lock_memory,
    set_affinity,
    set_fifo,
)
from aerarm_ros.ros.parameters.parameter import Parameter, grouped

REAL_TIME_PARAMETERS = grouped(
    'Real time',
    Parameter(
        'realtime_priority',
        0,
        'SCHED_FIFO priority of the loop; 0 leaves it to the ordinary scheduler',
        minimum=0,
        maximum=98,
    ),
    Parameter('lock_memory', False, 'keep all memory of the process in RAM'),
    Parameter(
        'keep_cpus_awake',
        False,
        'let no idle CPU of this computer sleep while the node runs: quicker wake-ups for power '
        'and heat',
    ),
)


def prepare_thread(values: SimpleNamespace, logger: RcutilsLogger) -> None:
    """Ask for what real time needs, for the calling thread and its process.

    What the system refuses is a warning with advice: the node works without.

    Parameters
    ----------
    values
        Of `REAL_TIME_PARAMETERS`; beside them `cpus` (list of CPUs) and `freeze_gc` (bool,
        otherwise true) if the node has these.
    logger
        Of the node.
    """
    cpus = getattr(values, 'cpus', ())
    warnings = [
        set_affinity(cpus) if cpus else None,
        set_fifo(values.realtime_priority) if values.realtime_priority else None,
        lock_memory() if values.lock_memory else None,
        keep_cpus_awake() if values.keep_cpus_awake else None,
        freeze_garbage_collector() if getattr(values, 'freeze_gc', True) else None,
    ]
    for warning in filter(None, warnings):
        logger.warning(warning)
