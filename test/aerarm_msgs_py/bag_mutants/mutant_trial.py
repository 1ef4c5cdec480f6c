"""Read one mutant in a separate process, and measure its result, time and memory."""

import json
import os
import re
import resource
import signal
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from aerarm_msgs_py.bags.bag_reader import read_contents
from aerarm_msgs_py.storage.read_limits import BagError

RIGHT, PART, REFUSED = 'right', 'part', 'refused'
ALTERED, FORGED, SHORTER = 'altered', 'forged', 'shorter'
PROMISED = (RIGHT, PART, REFUSED)
"""Outcomes that a mutant may have: all of the data; some, and a warning that says how much is
missing; one error. ALTERED, where nothing could show it: a storage without checksums. FORGED,
where the change itself wrote messages, with a right checksum. SHORTER, where it made the bag of
a killed recorder that of one which began later or was killed earlier: the same bytes."""

_MEMORY = 3 * 2**30  # bytes of address space, so that a failure does not affect the machine
_TIME = 60  # [s]
_FIGURE = re.compile(r'\d+ (of (the )?\d+ )?(messages|bytes)|last \d+ bytes|of the \d+ files')
_TOPIC, _OTHER = '/joint_states', '/motor_states'


@dataclass(frozen=True)
class TrialResult:
    """Result of reading a mutant.

    Attributes
    ----------
    outcome
        One of the constants above, or the error.
    time
        Processor time [s].
    memory
        Largest resident size of the process [MB].
    grown
        Growth of the process while reading [MB].
    """

    outcome: str
    time: float
    memory: float
    grown: float = 0.0


def rows_of(path: Path) -> list[bytes]:
    """Return each joint state of a bag, all its numbers as bytes."""
    series = read_contents(path, _TOPIC, [_OTHER]).joint_states[_TOPIC]
    numbers = (series.stamp, series.log_time, series.sequence.astype(float))
    columns = [column[:, None] for column in numbers]
    table = np.hstack([*columns, series.position, series.velocity, series.effort])
    return [row.tobytes() for row in np.ascontiguousarray(table)]


def tried(
    path: Path, original: list[bytes], checked: bool, forged: bool, finished: bool
) -> TrialResult:
    """Read a mutant in a child process and judge the result.

    Parameters
    ----------
    path
        The mutant.
    original
        Content of its valid bag.
    checked
        Whether its storage has checksums.
    forged
        Whether the mutation wrote messages itself.
    finished
        Whether the recorder of the valid bag ended normally.
    """
    read_end, write_end = os.pipe()
    child = os.fork()
    if not child:
        os.close(read_end)
        _run(path, original, checked, forged, finished, write_end)
    os.close(write_end)
    with os.fdopen(read_end, 'rb') as stream:
        said = stream.read()
    _, status, usage = os.wait4(child, 0)
    if not said:
        code = os.waitstatus_to_exitcode(status)
        return TrialResult(f'ended by {code}', usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
    return TrialResult(**json.loads(said))


def _run(
    path: Path, original: list[bytes], checked: bool, forged: bool, finished: bool, out: int
) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    signal.alarm(_TIME)
    before = resource.getrusage(resource.RUSAGE_SELF)
    outcome = _outcome(path, original, checked, forged, finished)
    after = resource.getrusage(resource.RUSAGE_SELF)
    reader = resource.getrusage(resource.RUSAGE_CHILDREN)  # for files that rosbags reads
    time = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    time += reader.ru_utime + reader.ru_stime
    grown = (after.ru_maxrss - before.ru_maxrss) / 1024
    result = TrialResult(outcome, time, (after.ru_maxrss + reader.ru_maxrss) / 1024, grown)
    os.write(out, json.dumps(asdict(result)).encode())
    os._exit(0)


def _outcome(path: Path, original: list[bytes], checked: bool, forged: bool, finished: bool) -> str:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        try:
            rows = rows_of(path)
        except BagError as error:
            return REFUSED if str(error) and '\n' not in str(error) else f'error {error!r}'
        except BaseException as error:  # any exception is a result of the trial
            return f'{type(error).__name__}: {str(error)[:200]}'
    if rows == original:
        return RIGHT
    if forged:
        return FORGED
    told = any(_FIGURE.search(str(warning.message)) for warning in caught)
    if _is_part(rows, original):
        if not told and not finished and rows and _is_run(rows, original):
            return SHORTER
        return PART if told else f'silent loss of {len(original) - len(rows)} messages'
    if not checked:
        return ALTERED if told or len(rows) >= len(original) else 'silent loss'
    repeated = len(rows) - len(set(rows))
    return f'{repeated} messages twice' if repeated else 'wrong data'


def _is_part(rows: list[bytes], original: list[bytes]) -> bool:
    """Return whether some rows are a subsequence of the original's."""
    left = iter(original)
    return all(row in left for row in rows)


def _is_run(rows: list[bytes], original: list[bytes]) -> bool:
    """Return whether some rows are consecutive in the original."""
    first = original.index(rows[0])
    return original[first : first + len(rows)] == rows
