"""Shared files are found in a checkout and in an installed tree."""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from aerarm_ros.description import resources
from aerarm_ros.description.drone_config import load_drone_config


def test_the_error_names_the_missing_file_and_the_existing_files() -> None:
    with pytest.raises(FileNotFoundError, match=r'arm\.urdf.*aerarm\.urdf'):
        resources.resource('urdf', 'arm.urdf')


def installed(prefix: Path, *, share: bool) -> subprocess.CompletedProcess[str]:
    """Run `share_directory` from a copy installed below `prefix`, as a ROS install lays it out."""
    site = prefix / 'lib' / 'python3.12' / 'site-packages'
    package = site / 'aerarm_ros' / 'description'
    package.mkdir(parents=True)
    (package.parent / '__init__.py').touch()
    (package / '__init__.py').touch()
    shutil.copy(resources.__file__, package)
    if share:
        config = prefix / 'share' / 'aerarm_ros' / 'config'
        config.mkdir(parents=True)
        shutil.copy(resources.resource('config', 'aerarm.yaml'), config)
    program = 'from aerarm_ros.description import resources; print(resources.share_directory())'
    command = [sys.executable, '-S', '-c', f'import sys; sys.path[:0] = [{str(site)!r}]; {program}']
    return subprocess.run(command, capture_output=True, text=True, cwd=prefix, check=False)


def test_an_installed_package_finds_its_share_folder_or_names_a_remedy(tmp_path: Path) -> None:
    found = installed(tmp_path / 'whole', share=True)
    share = tmp_path / 'whole' / 'share' / 'aerarm_ros'
    assert found.stdout.strip() == str(share.resolve()), found.stderr
    found = installed(tmp_path / 'bare', share=False)
    assert found.returncode != 0
    assert 'install the package again' in found.stderr


def test_packaged_files_are_found_from_anywhere_after_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ('config/drone.yaml', 'drone.yaml', 'drones/quadrotor.yaml'):
        found = resources.find_file(name)
        assert found.is_file() and found.is_relative_to(resources.share_directory() / 'config')
        assert load_drone_config(name).mass > 0.0
    for name in ('nothing.yaml', '/drone.yaml', '../config/drone.yaml'):
        assert resources.find_file(name) == Path(name)
    Path('drone.yaml').touch()
    assert resources.find_file('drone.yaml') == Path('drone.yaml')


def test_a_new_file_replaces_the_old_one_unless_writing_fails(tmp_path: Path) -> None:
    path, folder = tmp_path / 'text', tmp_path / 'folder'
    folder.mkdir()
    for text in ('before\n', 'ä\n'):
        resources.write_whole(path, text)
    for target, text, error in (
        (path, 'half of it \ud800', UnicodeEncodeError),
        (folder, 'text', IsADirectoryError),
    ):
        with pytest.raises(error):
            resources.write_whole(target, text)
    assert path.read_text(encoding='utf-8') == 'ä\n'
    assert sorted(tmp_path.iterdir()) == [folder, path]


def test_a_pipe_is_written_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    writer = threading.Thread(target=resources.write_whole, args=(pipe, 'text'))
    writer.start()
    assert pipe.read_text() == 'text'
    writer.join()
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
