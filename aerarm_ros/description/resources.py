"""Access to packaged files: URDF, configuration, launch and RViz files."""

import os
from pathlib import Path

PACKAGE = 'aerarm_ros'
_MARKER = Path('config') / 'aerarm.yaml'


def share_directory() -> Path:
    """Return the folder that contains `config/`, `urdf/`, `launch/` and `rviz/`.

    In a source checkout or an editable install, these folders are next to the package. In an
    installed package they are in `<prefix>/share/aerarm_ros`, where the prefix is any folder
    above site-packages.

    Raises
    ------
    FileNotFoundError
        If neither folder exists.
    """
    module = Path(__file__).resolve()
    for ancestor in module.parents:
        for candidate in (ancestor, ancestor / 'share' / PACKAGE):
            if (candidate / _MARKER).is_file():
                return candidate
    raise FileNotFoundError(
        f'the shared files of {PACKAGE} (such as {_MARKER}) are neither next to the package nor in '
        f'a folder share/{PACKAGE} above {module.parent}: install the package again, or run from '
        'a complete checkout'
    )


def find_file(path: Path | str) -> Path:
    """Return `path` if this file exists, or the packaged file of this name; else `path`.

    From any folder, `config/drone.yaml`, `drone.yaml` and `drones/quadrotor.yaml` refer to packaged
    files. A user's file with this path, relative to the working directory, takes precedence.
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
    """Return the path of a packaged file, for example `resource('urdf', 'aerarm.urdf')`.

    Raises
    ------
    FileNotFoundError
        If the file does not exist; the message lists the files in the folder.
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
    """Write a text file; an existing file is replaced only after the new file is complete.

    Special files such as /dev/stdout are written directly. If `durable` is False, readers always
    see a complete file, but the file is not synchronized to the disk.

    Raises
    ------
    OSError
        If writing fails; the previous content is kept, and no other file is left.
    """
    if path.exists() and not path.is_file():  # a device must not be replaced by a regular file
        path.write_text(text, encoding='utf-8')
        return
    temporary = path.with_name(f'{path.name}.{os.getpid()}.part')
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
