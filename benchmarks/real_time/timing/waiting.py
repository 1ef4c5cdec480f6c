"""Wait for another process."""

import time
from collections.abc import Callable


def wait_until(condition: Callable[[], object], patience: float = 60.0) -> None:
    """Wait until a condition holds, at most a time [s]."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError('the other process was not found: check ROS_DOMAIN_ID')
        time.sleep(0.01)
