"""Files of a design: trajectories, their previews."""

from pathlib import Path

from aerarm_ros.description.whole_file import write_whole
from aerarm_ros.excitation.settings.excitation_error import ExcitationError


def write_design(path: Path | str, text: str) -> None:
    """Write a text file, whole or not at all.

    Raises
    ------
    ExcitationError
        If it cannot be written.
    """
    try:
        write_whole(Path(path), text)
    except OSError as error:
        raise ExcitationError(
            f'{path} cannot be written: {error.strerror}: check the folder and its permissions'
        ) from error
