"""Distances compared with geometry by hand, and the certificate with a dense sweep."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from boxed_arm import with_box

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory

UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])
# Height of joint 2, urdf/aerarm.urdf.
SHOULDER = 0.167


def ground_distance(checker: ClearanceChecker, q: np.ndarray) -> float:
    rows = [i for i, pair in enumerate(checker.pairs) if 'ground' in pair]
    return float(checker.distances(q)[rows].min())


def test_ground_distance_of_the_arm_stretched_out(clearance: ClearanceChecker) -> None:
    # Motor 4 reaches lowest; motor 2 does too, but its distance never changes.
    lowest_radius = 0.032
    assert ground_distance(clearance, np.zeros(4)) == pytest.approx(
        SHOULDER + 0.01 - lowest_radius, abs=1e-6
    )


def test_ground_distance_when_joint_2_swings_below_the_horizon(clearance: ClearanceChecker) -> None:
    down = clearance.distances(np.array([0.0, -0.3, 0.0, 0.0]))
    level = clearance.distances(np.zeros(4))
    row = next(i for i, pair in reversed(list(enumerate(clearance.pairs))) if 'ground' in pair)
    # The tool's tip lies 0.75 m out: it sinks by that times the sine (and its radius tilts).
    assert level[row] - down[row] == pytest.approx(0.75 * np.sin(0.3), abs=2e-3)


def test_neighbours_are_not_pairs(clearance: ClearanceChecker) -> None:
    neighbours = {('base_link', 'link1'), ('link1', 'link2'), ('link2', 'link3')}
    assert not neighbours & set(clearance.pairs)
    assert ('link2', 'link4') in clearance.pairs


def test_the_certificate_encloses_a_dense_sweep(
    clearance: ClearanceChecker, trajectory: FourierTrajectory
) -> None:
    positions = trajectory.evaluate(np.arange(0.0, trajectory.period, 1e-3)).q
    found = clearance.sweep(positions)
    dense = np.array([clearance.distances(q) for q in positions[::2]])
    for kind, rows in clearance._kinds.items():
        true = dense[:, rows].min()
        assert found[kind].guaranteed <= true <= found[kind].distance + 1e-5
        assert found[kind].guaranteed > true - ClearanceChecker.RESOLUTION - 1e-5


def test_distance_never_changes_faster_than_the_bound(clearance: ClearanceChecker) -> None:
    generator = np.random.default_rng(5)
    for _ in range(200):
        a = generator.uniform(-2.0, 2.0, 4)
        b = a + generator.uniform(-0.2, 0.2, 4)
        change = np.abs(clearance.distances(a) - clearance.distances(b))
        assert (change <= clearance._bounds @ np.abs(a - b) + 1e-6).all()


def test_margin_gradient_by_finite_differences(clearance: ClearanceChecker, robot: Robot) -> None:
    generator, step = np.random.default_rng(6), 1e-4
    for q in generator.uniform(robot.position_min, robot.position_max, (50, 4)):
        numeric = [
            (clearance.margin(q + step * e) - clearance.margin(q - step * e)) / (2.0 * step)
            for e in np.eye(4)
        ]
        np.testing.assert_allclose(clearance.margin_gradient(q), numeric, atol=1e-2)


def test_links_that_are_close_by_construction_have_a_reduced_clearance(
    example_urdf: Callable[[str], Path],
) -> None:
    fingers = ('panda_finger_joint1', 'panda_finger_joint2')
    panda = ClearanceChecker(load_robot(example_urdf('panda.urdf'), locked=fingers), 0.02)
    required = dict(zip(panda.pairs, panda.required, strict=True))
    assert 0.0 < required['panda_link5', 'panda_link7'] < 0.02
    assert required['panda_link0', 'panda_link7'] == 0.02


def test_ground_is_below_along_gravity() -> None:
    hanging = load_robot(gravity_in_base=(0.0, 0.0, 9.81))
    checker = ClearanceChecker(hanging, ground_height=-1.5)
    # Hanging, 'up' is the base's -z: the arm stretched towards +z points at the ground.
    assert ground_distance(checker, UPRIGHT) == pytest.approx(1.5 - SHOULDER - 0.75, abs=1e-3)


def test_shapes_on_the_base_are_obstacles(robot: Robot) -> None:
    checker = ClearanceChecker(with_box(robot, '0.3 0 0.4', '0.02 0.02 0.3'))
    without = ClearanceChecker(robot)
    into_the_leg = np.array([0.0, np.arctan2(0.25, 0.3), 0.0, 0.0])
    assert checker.distances(into_the_leg).min() < 0.0 < without.distances(into_the_leg).min()


@pytest.mark.parametrize('link', ['base_link', 'landing_gear'])
def test_an_obstacle_that_only_link_1_can_hit(robot: Robot, link: str) -> None:
    """The corner of the fork's plate, 52 mm from joint 1's axis, sweeps over the box."""
    checker = ClearanceChecker(with_box(robot, '0.058 0 0.11', '0.02 0.01 0.02', link))
    corner_to_the_box = UPRIGHT + [np.arctan2(0.046, 0.025), 0.0, 0.0, 0.0]
    hits = {
        pair
        for pair, distance in zip(checker.pairs, checker.distances(corner_to_the_box), strict=True)
        if distance < 0.0
    }
    assert {frozenset(pair) for pair in hits} == {frozenset({link, 'link1'})}
    swept = checker.sweep(np.linspace(UPRIGHT, corner_to_the_box, 200))
    assert swept['self'].distance < 0.0


def test_a_urdf_without_shapes_is_refused(robot: Robot) -> None:
    bare = robot.urdf_text.replace('collision', 'ignored')
    with pytest.raises(ExcitationError, match='has a <collision> shape, so clearances are unknown'):
        ClearanceChecker(load_robot(bare))


@pytest.mark.parametrize('value', [-0.01, float('nan')])
def test_clearance_must_not_be_negative(robot: Robot, value: float) -> None:
    with pytest.raises(ExcitationError, match='clearances .* must be finite'):
        ClearanceChecker(robot, self_clearance=value)
