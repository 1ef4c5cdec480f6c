import os
from pathlib import Path

import pytest
from launched import is_in_the_index

from aerarm_ros import launch_requirements
from aerarm_ros.description.resources import resource
from aerarm_ros.launch_requirements import FILES, missing, packaged_files

GIVEN = {
    'hardware': 'fake',
    'rviz': 'false',
    'view': 'false',
    'autopilot': 'mavros',
    'urdf': str(resource('urdf', 'aerarm.urdf')),
    'trajectory': "''",  # launch's own way to give nothing
    'identified': '',
}


@pytest.mark.parametrize('name', FILES)
def test_a_file_must_exist(name: str, tmp_path: Path) -> None:
    path = tmp_path / 'given'
    absent = [f'the file {path} (argument {name}) does not exist: check the path']
    assert missing({**GIVEN, name: str(path)}) == absent
    path.mkdir()
    assert missing({**GIVEN, name: str(path)}) == absent
    path.rmdir()
    path.touch()
    assert missing({**GIVEN, name: str(path)}) == []
    path.chmod(0)
    if not os.access(path, os.R_OK):  # it is for root
        assert 'is not readable' in missing({**GIVEN, name: str(path)})[0]


@pytest.mark.parametrize(
    ('name', 'file'),
    [
        ('params_file', 'config/parameters_fake.yaml'),
        ('config', 'aerarm.yaml'),
        ('urdf', 'urdf/aerarm.urdf'),
        ('plant_urdf', 'aerarm.urdf'),
        ('drone_file', 'drones/quadrotor.yaml'),
        ('excitation_config', 'excitation.yaml'),
    ],
)
def test_a_packaged_file_may_be_named(
    name: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert missing({**GIVEN, name: file}) == []
    path = Path(packaged_files({name: file})[name])
    assert path.is_file()
    assert path.is_absolute()
    assert path.parts[-len(Path(file).parts) :] == Path(file).parts
    own = tmp_path / file
    own.parent.mkdir(parents=True, exist_ok=True)
    own.touch()
    assert packaged_files({name: file}) == {}


DRONE = str(resource('config', 'drone.yaml'))
FREE = {'base_motion': 'free'}


@pytest.mark.parametrize(
    ('given', 'problems'),
    [
        ({}, []),
        # Results of a run are not packaged.
        *(
            ({name: 'aerarm.urdf'}, [f'the file aerarm.urdf (argument {name}) does not exist'])
            for name in ('trajectory', 'identified')
        ),
        ({'tf_prefix': 'left_'}, []),
        ({'tf_prefix': '/left'}, ["tf_prefix '/left' must begin with a letter"]),
        (FREE, ['base_motion:=free needs a drone file']),
        ({**FREE, 'drone_file': "''"}, ['base_motion:=free needs a drone file']),
        ({**FREE, 'drone_file': DRONE}, []),
        ({'base_motion': 'full'}, []),
        (
            {'config': '/nowhere', 'urdf': '/nowhere'},
            ['the file /nowhere (argument config)', 'the file /nowhere (argument urdf)'],
        ),
    ],
    ids=str,
)
def test_each_problem_is_reported(
    given: dict[str, str], problems: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = missing({**GIVEN, **given})
    assert [text[: len(start)] for text, start in zip(found, problems, strict=True)] == problems


def test_rviz_is_an_own_package_as_its_frames_are() -> None:
    packages = ('rviz2', 'robot_state_publisher')
    found = missing({**GIVEN, 'rviz': 'true'})
    absent = [package for package in packages if not is_in_the_index(package)]
    assert [text.split()[5].rstrip(',') for text in found] == absent
    assert all('sudo apt install ros-jazzy-' in text for text in found)


@pytest.mark.parametrize(
    ('name', 'value', 'module'),
    [
        ('hardware', 'fake', 'mujoco'),
        ('hardware', 'spi', 'spidev'),
        ('view', 'true', 'viser'),
        ('autopilot', 'px4', 'px4_msgs'),
    ],
)
def test_modules_are_missed_only_where_they_are_needed(
    name: str, value: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = ('mujoco', 'spidev', 'viser', 'px4_msgs')
    monkeypatch.setattr(launch_requirements, 'find_spec', lambda name: name not in hidden or None)
    others = {key: text for key, text in GIVEN.items() if key not in ('hardware', name)}
    assert missing(others) == []
    (text,) = missing({**others, name: value})
    needs = f'the launch argument {name}:={value} needs the Python package {module}: '
    assert text.startswith(needs)
