"""A file that is written under a temporary name first."""

import os
import threading
from pathlib import Path

import pytest

from aerarm_ros.description.resources import write_whole


def test_a_new_file_replaces_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / 'text'
    for text in ('before\n', 'ä\n'):
        write_whole(path, text)
    assert path.read_text(encoding='utf-8') == 'ä\n'
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / 'text'
    path.write_text('before')
    with pytest.raises(UnicodeEncodeError):
        write_whole(path, 'half of it \ud800')
    folder = tmp_path / 'folder'
    folder.mkdir()
    with pytest.raises(IsADirectoryError):
        write_whole(folder, 'text')
    assert path.read_text() == 'before'
    assert sorted(tmp_path.iterdir()) == [folder, path]


def test_a_pipe_is_written_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    writer = threading.Thread(target=write_whole, args=(pipe, 'text'))
    writer.start()
    assert pipe.read_text() == 'text'
    writer.join()
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
