from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.ros.parameters.shared_parameters import load_drone

CONFIG, ROBOT = load_arm_config(), load_robot()


def test_no_file_is_no_drone() -> None:
    assert load_drone(SimpleNamespace(drone_file=''), CONFIG, ROBOT) is None


def test_a_drone_that_lifts_the_arm_is_read() -> None:
    values = SimpleNamespace(drone_file=str(resource('config', 'drones', 'quadrotor.yaml')))
    drone = load_drone(values, CONFIG, ROBOT)
    assert drone is not None
    assert drone.name == 'quadrotor'


def test_a_drone_that_lifts_only_itself_is_refused(tmp_path: Path) -> None:
    document = yaml.safe_load(resource('config', 'drones', 'quadrotor.yaml').read_text())
    for rotor in document['rotors']:
        rotor['thrust_max'] = 6.0
    path = tmp_path / 'weak.yaml'
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(ValueError, match=r'drone and arm \(1\.3 \+ 1\.49 kg\)'):
        load_drone(SimpleNamespace(drone_file=str(path)), CONFIG, ROBOT)
