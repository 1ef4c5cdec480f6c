"""The installed commands: each runs the `main` of its module in `aerarm_ros.nodes`.

What a node needs takes some tenths of a second to import, and a Ctrl-C meanwhile is an ordinary
end too. So the commands come through here, where nothing is imported beforehand.
"""

import importlib
from collections.abc import Callable
from functools import partial

_INTERRUPTED = 130  # as shells say it; also in nodes.exit_status, which would import too much


def __getattr__(name: str) -> Callable[[], int]:
    """Return the command of a module in `aerarm_ros.nodes`, for `from ... import NAME`."""
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(_run, name)


def _run(name: str) -> int:
    try:
        main = importlib.import_module(f'aerarm_ros.nodes.{name}').main
    except KeyboardInterrupt:
        return _INTERRUPTED
    status: int = main()
    return status
