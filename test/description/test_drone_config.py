"""Reading a drone file: valid values are kept, impossible ones are named."""

from pathlib import Path

import numpy as np
import pytest
from changed_yaml import MISSING, changed_yaml
from scipy.spatial.transform import Rotation

from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource

FILES = ('drone.yaml', 'drones/tilted_hexarotor.yaml', 'drones/quadrotor.yaml')
ARM = (1.487, [0.0, 0.0, 0.4])  # mass, and centre in the base frame: stretched out downwards


@pytest.mark.parametrize('name', FILES)
def test_packaged_drones_hover_with_the_arm(name: str) -> None:
    drone = load_drone_config(resource('config', *name.split('/')))
    drone.check_carries(*ARM)
    assert drone.is_fully_actuated == ('tilted' in name)
    # Equal thrusts: only a force, along the body's z.
    wrench = drone.allocation @ np.ones(drone.n)
    np.testing.assert_allclose(wrench[[0, 1, 3, 4, 5]], 0.0, atol=1e-5)
    assert wrench[2] > 0.9 * drone.n
    # The arm hangs upside down: its base's z points to the ground.
    np.testing.assert_allclose(drone.gravity_in_base, [0.0, 0.0, 9.81], atol=1e-12)


def test_a_rotor_pushes_where_it_is_and_drags_against_its_turn(tmp_path: Path) -> None:
    changes = {'rotors.1.position': [0.1, 0.3, 0.05], 'rotors.1.axis': [0.0, 0.6, 0.8]}
    drone = load_drone_config(changed_yaml(tmp_path, 'drone.yaml', changes))
    force = np.array([0.0, 0.6, 0.8])
    lever = np.array([0.1, 0.3, 0.05])
    k = drone.rotors[1].moment_per_thrust
    assert k < 0.0
    expected = np.concatenate([force, np.cross(lever, force) + k * force])
    np.testing.assert_allclose(drone.allocation[:, 1], expected, atol=1e-12)


def test_a_heavier_arm_than_the_rotors_lift_is_refused() -> None:
    drone = load_drone_config()
    with pytest.raises(
        ConfigError, match=(r'hexarotor: with level rotors its largest thrust is .* \(3 \+ 9 kg\)')
    ):
        drone.check_carries(9.0, [0.0, 0.0, 0.4])
    # Light enough, but too far out: one side would need more than it has.
    drone.check_carries(3.0, [0.0, 0.0, 0.5])
    with pytest.raises(ConfigError, match='a central mount'):
        drone.check_carries(3.0, [0.9, 0.0, 0.2])


def of_all_rotors(key: str, value: object) -> dict[str, object]:
    return {f'rotors.{i}.{key}': value for i in range(6)}


WRONG: list[tuple[dict[str, object], str]] = [
    ({'inertia': [0.045, 0.045, 0.2, 0, 0, 0]}, r'0\.2 kg m\^2; all must be positive'),
    ({'inertia': [4.5, 4.5, 8.0, 0, 0, 0]}, r'moment 8 kg m\^2, but 3 kg within the extent'),
    ({'inertia': [0.05, 0.05, 0.08, 0.06, 0, 0]}, r'principal moments -0\.0'),
    ({'inertia': [0.05, 0.05, 0.0, 0, 0, 0]}, 'must be positive'),
    ({'inertia': [0.05, 0.05, 0.08]}, 'needs ixx, iyy, izz, ixy'),
    ({'inertia': [float('nan'), 0.05, 0.08, 0, 0, 0]}, 'inertia = nan'),
    ({'mass': 0}, 'mass = 0'),
    ({'mass': 3000}, r'mass = 3000.*\[kg\]'),
    ({'mass': 'heavy'}, 'mass must be a number'),
    ({'mount.position': [0, 0, -0.12]}, r'mount at \[0\.0, 0\.0, -0\.12\] m is outside the body'),
    ({'mount.position': [0, 0, -80]}, r'mount: position = -80.*\[m\]'),
    ({'mount.rpy': [180, 0, 0]}, r'mount: rpy = 180.*\[rad\]'),
    ({'mount.position': [0, 0]}, 'mount: position .* must be a list of x, y and z'),
    ({'mount.position': MISSING}, 'mount lacks the key position'),
    ({'mount': [0, 0, 0]}, 'mount must be a mapping'),
    ({'imu.position': [0.2, 0, 0]}, 'imu at .* is outside the body'),
    ({'centre_of_mass': [0, 0, 0.1]}, 'centre_of_mass at .* outside the body'),
    ({'size': [0.26, 0.26, 0]}, 'size .* must be positive'),
    ({'rotors': []}, 'rotors must be a non-empty list'),
    ({'rotors': [1]}, r'rotors\[0\] must be a mapping'),
    ({'rotors.1.name': 'front_left'}, "rotors: name 'front_left' occurs twice"),
    ({'rotors.0.axis': [0, 0, 2]}, 'rotor front_left: axis has length 2 instead of 1'),
    ({'rotors.0.thrust_max': 0}, 'thrust_max = 0'),
    ({'rotors.0.thrust_min': 30}, 'thrust_min = 30.0 must be below'),
    ({'rotors.0.time_constant': 25}, r'time_constant = 25.*\[s\]'),
    (of_all_rotors('moment_per_thrust', 0.0), 'moment_per_thrust'),
    (of_all_rotors('position', [0.3, 0.0, 0.0]), 'check their positions'),
    (of_all_rotors('thrust_max', 5.0), r'thrust is 1\.0\d times its weight \(3 kg\)'),
    (of_all_rotors('axis', [0.0, 0.0, -1.0]), 'thrust is 0.00 times its weight'),
    ({'colour': 'red'}, 'unknown key colour'),
    ({'rotors.2.kv': 300}, r'rotors\[2\] has the unknown key kv'),
    ({'name': 7}, 'name = 7 must be a name'),
]


@pytest.mark.parametrize(('changes', 'message'), WRONG)
def test_an_invalid_file_raises_one_line_that_names_the_key(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_drone_config(changed_yaml(tmp_path, 'drone.yaml', changes))
    text = str(caught.value)
    assert 'my_drone.yaml' in text
    assert '\n' not in text


def test_products_of_inertia_and_angles_are_those_of_a_urdf(tmp_path: Path) -> None:
    changes = {'inertia': [0.04, 0.05, 0.08, 0.001, -0.002, 0.003], 'mount.rpy': [0.3, -1.2, 2.5]}
    drone = load_drone_config(changed_yaml(tmp_path, 'drone.yaml', changes))
    expected = [[0.04, 0.001, -0.002], [0.001, 0.05, 0.003], [-0.002, 0.003, 0.08]]
    np.testing.assert_array_equal(drone.inertia_matrix, expected)
    turn = Rotation.from_euler('xyz', [0.3, -1.2, 2.5])  # about the fixed axes, in this order
    np.testing.assert_allclose(drone.mount.rotation, turn.as_matrix(), atol=1e-12)
