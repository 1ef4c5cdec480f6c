"""Files shipped with the code: URDF, configuration, launch and RViz files."""

import os
from pathlib import Path

PACKAGE = 'aerarm_ros'
_MARKER = Path('config') / 'aerarm.yaml'


def share_directory() -> Path:
    """Return the folder that holds `config/`, `urdf/`, `launch/` and `rviz/`.

    A source checkout (or an editable install) has them beside the package; an
    installed package has them in `<prefix>/share/aerarm_ros`, whatever the depth of
    site-packages below the prefix.

    Raises
    ------
    FileNotFoundError
        If neither is found.
    """
    module = Path(__file__).resolve()
    for ancestor in module.parents:
        for candidate in (ancestor, ancestor / 'share' / PACKAGE):
            if (candidate / _MARKER).is_file():
                return candidate
    raise FileNotFoundError(
        f"the shared files of {PACKAGE} (such as {_MARKER}) are neither in the package's parent "
        f'folder nor in a share/{PACKAGE} folder above {module.parent}: install the package '
        'again, or run from a complete checkout'
    )


def find_file(path: Path | str) -> Path:
    """Return the file of a path, or the packaged one of that name if the path does not exist.

    `config/drone.yaml`, `drone.yaml` and `drones/quadrotor.yaml` name packaged files from any
    folder; a file of one's own, relative to the working directory, comes first.
    """
    given = Path(path)
    if given.exists() or given.is_absolute() or '..' in given.parts:
        return given
    share = share_directory()
    for folder in (share, share / 'config', share / 'urdf'):
        if (folder / given).is_file():
            return folder / given
    return given


def resource(*parts: str) -> Path:
    """Return the path of a shared file, e.g. `resource('urdf', 'aerarm.urdf')`.

    Raises
    ------
    FileNotFoundError
        If there is no such file; the message lists what the folder does hold.
    """
    path = share_directory().joinpath(*parts)
    if not path.exists():
        folder = path.parent
        present = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
        raise FileNotFoundError(
            f'shared file {path} does not exist: the folder contains '
            f'{", ".join(present) or "nothing"}'
        )
    return path


def write_whole(path: Path, text: str, durable: bool = True) -> None:
    """Write a text file, in place of one of that name only once all of it is on the disk.

    What is no file, as /dev/stdout, is written to. If not `durable`, the file is whole for whoever
    reads it, but is not forced to the disk.

    Raises
    ------
    OSError
        If it cannot be written; what was there before still is, and nothing else.
    """
    if path.exists() and not path.is_file():  # a device must not be replaced by a file
        path.write_text(text, encoding='utf-8')
        return
    beside = path.with_name(f'{path.name}.{os.getpid()}.part')
    try:
        with beside.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
