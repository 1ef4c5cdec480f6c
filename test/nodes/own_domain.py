"""A ROS domain that nobody else is in."""

import os
import random

from aerarm_ros.ros.process.node_process import is_domain_free


def own_domain() -> dict[str, str]:
    """Return the variables of a free domain, for this process or another."""
    # Domains above 101 use ports that the system hands out to others. Each of the processes that
    # share the tests has domains of its own.
    workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    own = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    domains = random.sample(range(1 + own, 102, workers), 101 // workers)
    return {
        'ROS_DOMAIN_ID': str(next(filter(is_domain_free, domains))),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
