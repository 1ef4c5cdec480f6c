"""How many threads NumPy's linear algebra may use; to be said before NumPy is imported.

An arm's matrices are small. Threads that share one fight over it: beside a loop at real-time
priority, the solution of four equations took milliseconds on them instead of microseconds.
"""

import os
from collections.abc import MutableMapping

THREAD_VARIABLES = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


def use_one_thread(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let the linear algebra of this process use one thread, unless the user says otherwise."""
    for name in THREAD_VARIABLES:
        environment.setdefault(name, '1')
