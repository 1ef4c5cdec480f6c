"""Installed files: executables, both packages, and shared files."""

import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from functools import cache
from pathlib import Path

import yaml
from source_files import listed_in_setup

import aerarm_ros
from aerarm_ros.executables import command_modules

ROOT = Path(__file__).resolve().parents[2]


def test_the_wheel_contains_both_packages_the_shared_files_and_executables(wheel: Path) -> None:
    content = zipfile.ZipFile(wheel)
    names = content.namelist()
    modules = {'aerarm_ros/nodes/hardware_bridge.py', 'aerarm_msgs_py/topics.py'}
    assert modules | {'aerarm_ros/py.typed'} <= set(names)
    shared = {name.split('.data/data/share/')[1] for name in names if '.data/data/share/' in name}
    assert {
        'ament_index/resource_index/packages/aerarm_ros',
        'aerarm_ros/package.xml',
        'aerarm_ros/config/aerarm.yaml',
        'aerarm_ros/config/fastdds.xml',
        'aerarm_ros/config/fastdds_loopback.xml',
        'aerarm_ros/config/profiles/uomodri_v3.yaml',
        'aerarm_ros/urdf/aerarm.urdf',
    } <= shared
    assert not any(name.startswith('test') for name in names)
    (listing,) = [name for name in names if name.endswith('entry_points.txt')]
    lines = [line for line in content.read(listing).decode().splitlines() if '=' in line]
    assert len(lines) >= 5
    for line in lines:
        name, target = (part.strip() for part in line.split('='))
        assert target == f'aerarm_ros.executables:{name}'
        module = command_modules()[name].replace('.', '/')
        assert re.search(r'\n(def main\(|main = )', content.read(f'{module}.py').decode())
    assert '$base/lib/aerarm_ros' in (ROOT / 'setup.cfg').read_text()  # where ros2 run looks


def test_package_xml_is_format_3_ament_python_of_the_same_version() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.get('format') == '3'
    assert package.findtext('export/build_type') == 'ament_python'
    version = package.findtext('version')
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert cited['version'] == version
    (released, date), *_ = re.findall(
        r'^## (\d+\.\d+\.\d+) - (\S+)$', (ROOT / 'CHANGELOG.md').read_text(), flags=re.MULTILINE
    )
    assert (released, date) == (version, str(cited['date-released']))


def test_every_compiled_module_exists() -> None:
    modules = listed_in_setup('COMPILED')
    folder = ROOT / 'aerarm_ros' / 'hardware'
    assert [name for name in modules if not (folder / f'{name}.py').is_file()] == []
    assert 'bridge_cycle' in modules


def test_makefile_setup_ci_and_hosts_name_the_same_pythons() -> None:
    beside_ros, of_wheels = re.findall(r'^PYTHONS +:= (.+)$', (ROOT / 'Makefile').read_text(), re.M)
    assert beside_ros == '3.12'
    pythons = of_wheels.split()
    oldest, newest = pythons[0], pythons[-1]
    after = f'3.{int(newest.removeprefix("3.")) + 1}'
    assert f"python_requires='>={oldest},<{after}'" in (ROOT / 'setup.py').read_text()
    workflow = yaml.safe_load((ROOT / '.github' / 'workflows' / 'ci.yml').read_text())
    assert workflow['jobs']['wheels']['strategy']['matrix']['python'] == pythons
    for page in ('README.md', 'docs/reference/hosts.md', 'docs/tutorial.md'):
        assert f'{oldest} to {newest}' in (ROOT / page).read_text()


@cache
def requirements(distribution: str) -> list[str]:
    """Return the requirements of setup.py under a ROS distribution, '' for none."""
    script = (
        'import json, runpy, setuptools\n'
        "setuptools.setup = lambda **given: print(json.dumps(given['install_requires']))\n"
        "runpy.run_path('setup.py')"
    )
    environment = {**os.environ, 'ROS_DISTRO': distribution}
    command = [sys.executable, '-c', script]
    run = subprocess.run(
        command, check=True, capture_output=True, text=True, cwd=ROOT, env=environment
    )
    return json.loads(run.stdout)


def test_with_ros_from_apt_no_dependency_requires_numpy_2() -> None:
    assert 'numpy>=1.26,<2' in requirements('jazzy')
    assert not any(wanted.startswith('pin') for wanted in requirements('jazzy'))
    assert {'numpy>=1.26,<3', 'pin>=3.3,<5'} <= set(requirements(''))


def test_the_list_for_apt_hosts_has_all_that_is_not_from_apt() -> None:
    lines = (ROOT / 'requirements-apt.txt').read_text().splitlines()
    listed = {line for line in lines if line and not line.startswith('#')}
    from_apt = ElementTree.parse(ROOT / 'package.xml').getroot().findall('exec_depend')
    names = {'python3-scipy': 'scipy', 'python3-yaml': 'pyyaml'}
    brought = {names.get(depend.text or '') for depend in from_apt}
    wanted = {text for text in requirements('jazzy') if text.partition('>')[0] not in brought}
    assert wanted <= listed
    assert {text.partition('>')[0] for text in listed - wanted} == {'viser', 'example-robot-data'}


def test_offered_names_are_imported_on_first_use() -> None:
    assert aerarm_ros.__all__
    for name in aerarm_ros.__all__:
        assert getattr(aerarm_ros, name) is not None
    script = "import aerarm_ros, sys; print(*(m for m in sys.modules if m.startswith('aerarm_')))"
    run = subprocess.run(
        [sys.executable, '-c', script], check=True, capture_output=True, text=True, cwd=ROOT
    )
    assert run.stdout.split() == ['aerarm_ros']
