"""A ROS domain without other processes."""

import fcntl
import random
import tempfile
from itertools import cycle
from pathlib import Path
from typing import IO

from aerarm_ros.ros.process.node_process import is_domain_free

# Domains above 101 use ports that the system assigns dynamically.
_domains = cycle(random.sample(range(1, 102), 101))
_held: list[IO[str]] = []
_KEPT = 4


def own_domain() -> dict[str, str]:
    """Return the variables of a free domain, for this process or another.

    A test may use several domains at once, so this process keeps its last four; test runs of one
    host hold a lock on theirs. The same domain returns as late as possible, when its last node has
    surely ended.
    """
    while len(_held) >= _KEPT:
        _held.pop(0).close()
    for _ in range(101):
        domain = next(_domains)
        if _lock(domain) and is_domain_free(domain):
            return {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    raise RuntimeError('all ROS domains of this host are in use: end other nodes')


def others_in(domain: str) -> list[str]:
    """Return process ids and command lines of all processes with a ROS_DOMAIN_ID."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            variables = (folder / 'environ').read_bytes().split(b'\0')
            command = (
                (folder / 'cmdline').read_bytes().replace(b'\0', b' ').decode(errors='replace')
            )
        except OSError:
            continue
        if f'ROS_DOMAIN_ID={domain}'.encode() in variables:
            found.append(f'{folder.name}: {command[:150]}')
    return found


def _lock(domain: int) -> bool:
    path = Path(tempfile.gettempdir()) / f'aerarm_ros_tests_domain_{domain}.lock'
    file = path.open('w')
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return False
    _held.append(file)
    return True
