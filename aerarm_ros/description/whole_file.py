"""Files that are there whole or not at all."""

import os
from pathlib import Path


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
