"""Reading a drone file: valid values are kept, impossible ones are named."""

from collections.abc import Callable
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource

Document = dict[str, Any]
FILES = ('drone.yaml', 'drones/tilted_hexarotor.yaml', 'drones/quadrotor.yaml')
ARM = (1.487, [0.0, 0.0, 0.4])  # mass, and centre in the base frame: stretched out downwards


@pytest.fixture
def write(tmp_path: Path) -> Callable[[Document], Path]:
    """Return a function that writes the packaged YAML with other values at some keys."""

    def write(changes: Document) -> Path:
        document = yaml.safe_load(resource('config', 'drone.yaml').read_text())
        for key, value in changes.items():
            place: Any = document
            *path, last = key.split('.')
            for name in path:
                place = place[int(name) if name.isdigit() else name]
            place[last] = value
        path = tmp_path / 'my_drone.yaml'
        path.write_text(yaml.safe_dump(document))
        return path

    return write


@pytest.mark.parametrize('name', FILES)
def test_packaged_drones_hover_with_the_arm(name: str) -> None:
    drone = load_drone_config(resource('config', *name.split('/')))
    drone.check_carries(*ARM)
    with pytest.raises(FrozenInstanceError):
        drone.mass = 1.0  # type: ignore[misc]
    # Equal thrusts: only a force, along the body's z.
    wrench = drone.allocation @ np.ones(drone.n)
    np.testing.assert_allclose(wrench[[0, 1, 3, 4, 5]], 0.0, atol=1e-5)
    assert wrench[2] > 0.9 * drone.n
    # The arm hangs upside down: its base's z points to the ground.
    np.testing.assert_allclose(drone.gravity_in_base, [0.0, 0.0, 9.81], atol=1e-12)


def test_packaged_drones_match_their_names() -> None:
    drones = [load_drone_config(resource('config', *name.split('/'))) for name in FILES]
    assert [drone.is_fully_actuated for drone in drones] == [0, 1, 0]
    assert [drone.mass for drone in drones] == [3.0, 3.0, 1.3]
    assert [drone.n for drone in drones] == [6, 6, 4]


def test_a_rotor_pushes_where_it_is_and_drags_against_its_turn(write: Callable) -> None:
    drone = load_drone_config(
        write({'rotors.1.position': [0.1, 0.3, 0.05], 'rotors.1.axis': [0.0, 0.6, 0.8]})
    )
    force = np.array([0.0, 0.6, 0.8])
    lever = np.array([0.1, 0.3, 0.05])
    k = drone.rotors[1].moment_per_thrust
    assert k < 0.0
    expected = np.concatenate([force, np.cross(lever, force) + k * force])
    np.testing.assert_allclose(drone.allocation[:, 1], expected, atol=1e-12)


def test_a_scaled_drone_has_the_given_errors() -> None:
    drone = load_drone_config()
    wrong = drone.with_errors(mass=1.2, inertia=0.8)
    assert wrong.mass == pytest.approx(1.2 * drone.mass)
    np.testing.assert_allclose(wrong.inertia_matrix, 0.8 * drone.inertia_matrix)
    assert wrong.rotors == drone.rotors


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


WRONG: dict[str, tuple[Document, str]] = {
    'triangle inequality': (
        {'inertia': [0.045, 0.045, 0.2, 0, 0, 0]},
        r'0\.045, 0\.045, 0\.2 kg m\^2; none may be larger',
    ),
    'inertia in kg dm^2': (
        {'inertia': [4.5, 4.5, 8.0, 0, 0, 0]},
        r'moment 8 kg m\^2, but 3 kg within the extent of body and rotors have at most',
    ),
    'off-diagonal too large': ({'inertia': [0.05, 0.05, 0.08, 0.06, 0, 0]}, 'principal moment -'),
    'no inertia about z': ({'inertia': [0.05, 0.05, 0.0, 0, 0, 0]}, 'must be positive'),
    'three moments': ({'inertia': [0.05, 0.05, 0.08]}, 'needs ixx, iyy, izz, ixy'),
    'NaN inertia': ({'inertia': [float('nan'), 0.05, 0.08, 0, 0, 0]}, 'inertia = nan'),
    'no mass': ({'mass': 0}, 'mass = 0'),
    'grams': ({'mass': 3000}, r'mass = 3000.*\[kg\]'),
    'mass as text': ({'mass': 'heavy'}, 'mass must be a number'),
    'mount below the body': (
        {'mount.position': [0, 0, -0.12]},
        r'mount at \[0\.0, 0\.0, -0\.12\] m is outside the body',
    ),
    'mount in mm': ({'mount.position': [0, 0, -80]}, r'mount: position = -80.*\[m\]'),
    'mount in degrees': ({'mount.rpy': [180, 0, 0]}, r'mount: rpy = 180.*\[rad\]'),
    'mount of two numbers': (
        {'mount.position': [0, 0]},
        'mount: position .* must be a list of x, y and z',
    ),
    'mount without position': ({'mount': {'rpy': [0, 0, 0]}}, 'mount lacks the key position'),
    'mount that is a list': ({'mount': [0, 0, 0]}, 'mount must be a mapping'),
    'IMU beside the body': ({'imu.position': [0.2, 0, 0]}, 'imu at .* is outside the body'),
    'centre outside': ({'centre_of_mass': [0, 0, 0.1]}, 'centre_of_mass at .* outside the body'),
    'flat body': ({'size': [0.26, 0.26, 0]}, 'size .* must be positive'),
    'no rotors': ({'rotors': []}, 'rotors must be a non-empty list'),
    'rotor as number': ({'rotors': [1]}, r'rotors\[0\] must be a mapping'),
    'twin rotors': ({'rotors.1.name': 'front_left'}, 'rotor front_left is listed twice'),
    'rotor without name': ({'rotors.1.name': ''}, "name = '' must be a name"),
    'axis of two': (
        {'rotors.0.axis': [0, 0, 2]},
        'rotor front_left: axis has length 2 instead of 1',
    ),
    'no thrust': ({'rotors.0.thrust_max': 0}, 'thrust_max = 0'),
    'limits crossed': ({'rotors.0.thrust_min': 30}, 'thrust_min = 30.0 must be below'),
    'lag in ms': ({'rotors.0.time_constant': 25}, r'time_constant = 25.*\[s\]'),
    'yaw without sign': (
        {f'rotors.{i}.moment_per_thrust': 0.0 for i in range(6)},
        'moment_per_thrust',
    ),
    'all on one arm': (
        {f'rotors.{i}.position': [0.3, 0.0, 0.0] for i in range(6)},
        'check their positions',
    ),
    'all on one side': (
        {
            f'rotors.{i}.position': [0.1 + 0.1 * (i // 2), 0.2 * (i % 3) - 0.2, 0.0]
            for i in range(6)
        },
        'thrust is 0.00 times its weight',
    ),
    'too weak': (
        {f'rotors.{i}.thrust_max': 5.0 for i in range(6)},
        r'thrust is 1\.0\d times its weight \(3 kg\)',
    ),
    'thrust downwards': (
        {f'rotors.{i}.axis': [0.0, 0.0, -1.0] for i in range(6)},
        'thrust is 0.00 times its weight',
    ),
    'unknown key': ({'colour': 'red'}, 'unknown key colour'),
    'unknown rotor key': ({'rotors.2.kv': 300}, r'rotors\[2\] has the unknown key kv'),
    'name that is none': ({'name': 7}, 'name = 7 must be a name'),
}


@pytest.mark.parametrize('case', WRONG)
def test_an_invalid_file_raises_one_line_that_names_the_key(case: str, write: Callable) -> None:
    changes, message = WRONG[case]
    with pytest.raises(ConfigError, match=message) as caught:
        load_drone_config(write(changes))
    text = str(caught.value)
    assert 'my_drone.yaml' in text
    assert '\n' not in text


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='check the path'):
        load_drone_config(tmp_path / 'none.yaml')


def test_products_of_inertia_are_where_a_urdf_has_them(write: Callable) -> None:
    drone = load_drone_config(write({'inertia': [0.04, 0.05, 0.08, 0.001, -0.002, 0.003]}))
    expected = [[0.04, 0.001, -0.002], [0.001, 0.05, 0.003], [-0.002, 0.003, 0.08]]
    np.testing.assert_array_equal(drone.inertia_matrix, expected)
