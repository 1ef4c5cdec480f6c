"""Distances compared with geometry by hand, a dense sweep, and the pairs that must keep apart."""

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


def test_ground_is_below_along_gravity() -> None:
    hanging = load_robot(gravity_in_base=(0.0, 0.0, 9.81))
    checker = ClearanceChecker(hanging, ground_height=-1.5)
    # Hanging, 'up' is the base's -z: the arm stretched towards +z points at the ground.
    assert ground_distance(checker, UPRIGHT) == pytest.approx(1.5 - SHOULDER - 0.75, abs=1e-3)


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


FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


def required(checker: ClearanceChecker, *links: str) -> set[float]:
    return {
        float(keep)
        for pair, keep in zip(checker.pairs, checker.required, strict=True)
        if set(pair) == set(links)
    }


def test_relaxed_and_unchecked_pairs_are_named(
    robot: Robot, example_urdf: Callable[[str], Path]
) -> None:
    assert ClearanceChecker(robot, ground_height=-0.01).notes == (
        'base_link to link1: not checked, because the distance is 0.003 m in every posture',
        'link1 to ground: not checked, because the distance is 0.035 m in every posture',
    )
    checker = ClearanceChecker(load_robot(example_urdf('ur10_robot.urdf')), ground_height=0.0)
    relaxed = [note for note in checker.notes if 'close together by design' in note]
    assert [note.partition(':')[0] for note in relaxed] == [
        'base_link to upper_arm_link',
        'forearm_link to wrist_2_link',
        'wrist_1_link to wrist_3_link',
    ]
    assert max(required(checker, 'forearm_link', 'wrist_2_link')) < 0.02


def test_the_ground_is_never_relaxed(example_urdf: Callable[[str], Path]) -> None:
    """The upper arm of a UR10 is 53 mm above its base's plane at most."""
    robot = load_robot(example_urdf('ur10_robot.urdf'))
    checker = ClearanceChecker(robot, ground_clearance=0.05, ground_height=0.0)
    assert required(checker, 'upper_arm_link', 'ground') == {0.05}
    with pytest.raises(
        ExcitationError, match='upper_arm_link to ground has a distance of at most 0.05'
    ):
        ClearanceChecker(robot, ground_clearance=0.06, ground_height=0.0)


def test_an_obstacle_always_near_is_refused_not_dropped(robot: Robot) -> None:
    """A skid beside link 1: in reach of its fork, always near it, or inside its column."""
    in_reach = with_box(robot, '0.07 0 0.11', '0.02 0.2 0.02', 'skid')
    assert required(ClearanceChecker(in_reach), 'skid', 'link1') == {0.02}
    with pytest.raises(ExcitationError, match='link1 to skid has a distance of at most 0.016'):
        ClearanceChecker(with_box(robot, '0.0515 0 0.11', '0.02 0.2 0.02', 'skid'))
    with pytest.raises(ExcitationError, match='link1 to skid has a distance of at most 0 m'):
        ClearanceChecker(with_box(robot, '0.03 0 0.07', '0.02 0.2 0.02', 'skid'))


def test_unusable_shapes_and_clearances_are_named(robot: Robot) -> None:
    bare = load_robot(robot.urdf_text.replace('collision', 'ignored'))
    with pytest.raises(ExcitationError, match='has a <collision> shape, so clearances are unknown'):
        ClearanceChecker(bare)
    for value in (-0.01, float('nan')):
        with pytest.raises(ExcitationError, match='clearances .* must be finite'):
            ClearanceChecker(robot, self_clearance=value)
    # Link 4's tool drawn so long that link 2 is inside it in every posture.
    shape = '<geometry><cylinder radius="0.012" length="0.046"/></geometry>'
    assert shape in robot.urdf_text
    huge = robot.urdf_text.replace(shape, '<geometry><sphere radius="2.0"/></geometry>')
    with pytest.raises(ExcitationError, match='of at most 0 m in every posture.* check sizes'):
        ClearanceChecker(load_robot(huge))


def test_the_user_may_answer_for_a_pair(robot: Robot) -> None:
    near = with_box(robot, '0.03 0 0.07', '0.02 0.2 0.02', 'skid')
    checker = ClearanceChecker(near, unchecked_pairs=['link1 to skid'])
    assert any(
        'skid' in note and 'not checked, because the pair is in unchecked_pairs' in note
        for note in checker.notes
    )
    assert not required(checker, 'skid', 'link1')
    assert required(checker, 'skid', 'link2') == {0.02}
    with pytest.raises(ExcitationError, match="'link1 to kids' is not a pair of links"):
        ClearanceChecker(near, unchecked_pairs=['link1 to kids'])


def test_moving_neighbours_are_no_pair(example_urdf: Callable[[str], Path]) -> None:
    panda = ClearanceChecker(load_robot(example_urdf('panda.urdf'), locked=FINGERS))
    links = [f'panda_link{i}' for i in range(1, 8)]
    neighbours = {frozenset(pair) for pair in zip(links, links[1:], strict=False)}
    assert not neighbours & {frozenset(pair) for pair in panda.pairs}
    assert np.isfinite(panda.required).all()
