"""What is installed: executables, both packages, and the shared files where they are found."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    out = tmp_path_factory.mktemp('wheel')
    command = [
        sys.executable,
        '-m',
        'pip',
        'wheel',
        '--quiet',
        '--no-deps',
        '-w',
        str(out),
        str(ROOT),
    ]
    subprocess.run(command, check=True, capture_output=True)
    (path,) = out.glob('*.whl')
    return zipfile.ZipFile(path)


def test_wheel_holds_both_packages_and_the_shared_files(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    for wanted in (
        'aerarm_ros/nodes/hardware_bridge.py',
        'aerarm_msgs_py/topics.py',
        'aerarm_ros/py.typed',
    ):
        assert wanted in names
    shared = {name.split('.data/data/')[1] for name in names if '.data/data/' in name}
    assert {
        'share/ament_index/resource_index/packages/aerarm_ros',
        'share/aerarm_ros/package.xml',
        'share/aerarm_ros/config/aerarm.yaml',
        'share/aerarm_ros/config/fastdds.xml',
        'share/aerarm_ros/config/profiles/uomodri_v3.yaml',
        'share/aerarm_ros/urdf/aerarm.urdf',
    } <= shared
    assert not any(name.startswith('test') for name in names)


def test_every_executable_has_a_main(wheel: zipfile.ZipFile) -> None:
    (listing,) = [name for name in wheel.namelist() if name.endswith('entry_points.txt')]
    lines = [line for line in wheel.read(listing).decode().splitlines() if '=' in line]
    assert len(lines) >= 5
    for line in lines:
        module, function = line.split('=')[1].strip().split(':')
        source = wheel.read(module.replace('.', '/') + '.py').decode()
        assert f'def {function}(' in source


def test_package_xml_is_format_3_ament_python_of_the_same_version() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.get('format') == '3'
    assert package.findtext('export/build_type') == 'ament_python'
    assert f"version='{package.findtext('version')}'" in (ROOT / 'setup.py').read_text()


def test_scripts_go_where_ros2_run_looks() -> None:
    assert '$base/lib/aerarm_ros' in (ROOT / 'setup.cfg').read_text()
