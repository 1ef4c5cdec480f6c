"""The installed commands: each runs the `main` of its module in `aerarm_ros.nodes`.

What a node needs takes some tenths of a second to import, and a Ctrl-C meanwhile is an ordinary
end too. So the commands come through here, where nothing is imported beforehand.
"""

import importlib
import signal
from collections.abc import Callable
from functools import partial


def __getattr__(name: str) -> Callable[[], int]:
    """Return the command of a module in `aerarm_ros.nodes`, for `from ... import NAME`."""
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(_run, name)


def _run(name: str) -> int:
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        # Extension modules make an ImportError of a KeyboardInterrupt. There is nothing to leave
        # in order yet: the signal may end the process, which shells call status 130.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    main = importlib.import_module(f'aerarm_ros.nodes.{name}').main
    signal.signal(signal.SIGINT, before)
    status: int = main()
    return status
