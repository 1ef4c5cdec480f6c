"""Shared files are found in a checkout and in an installed tree."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.description import resources


def test_a_checkout_holds_the_shared_files_beside_the_package() -> None:
    assert resources.resource('urdf', 'aerarm.urdf').is_file()
    assert resources.share_directory() == Path(resources.__file__).resolve().parents[2]


def test_a_missing_file_is_named_with_what_the_folder_holds() -> None:
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


def test_an_installed_package_finds_its_share_folder(tmp_path: Path) -> None:
    found = installed(tmp_path, share=True)
    assert found.stdout.strip() == str((tmp_path / 'share' / 'aerarm_ros').resolve()), found.stderr


def test_an_incomplete_installation_says_what_to_do(tmp_path: Path) -> None:
    found = installed(tmp_path, share=False)
    assert found.returncode != 0
    assert 'install the package again' in found.stderr
