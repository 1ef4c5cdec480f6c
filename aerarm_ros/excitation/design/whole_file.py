"""Files that are there whole or not at all."""

import os
from pathlib import Path

from aerarm_ros.excitation.settings.excitation_error import ExcitationError


def write_whole(path: Path | str, text: str) -> None:
    """Write a text file, in place of one of that name only once all of it is on the disk.

    Raises
    ------
    ExcitationError
        If it cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f'{path.name}.{os.getpid()}.tmp')
    try:
        temporary.write_text(text, encoding='utf-8')
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise ExcitationError(
            f'{path} cannot be written: {error.strerror}: check the folder and its permissions'
        ) from error
