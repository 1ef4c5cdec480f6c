"""What a page was made with."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from datetime import datetime
from importlib import metadata
from pathlib import Path

_PACKAGE = 'aerarm_ros'


def origin(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Return date, version and command line of this run; of `arguments`, by default its own."""
    program, *rest = sys.argv if arguments is None else arguments
    try:
        version = metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        version = 'not installed'
    return {
        'made': f'{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}',
        'by': f'{_PACKAGE} {version}',
        'command': shlex.join([Path(program).name, *rest]),
    }
