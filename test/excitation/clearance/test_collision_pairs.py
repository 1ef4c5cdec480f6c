"""Pairs that must keep apart: none is left out, and each omission is reported."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from boxed_arm import with_box

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import ExcitationError

FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


def required(checker: ClearanceChecker, *links: str) -> set[float]:
    return {
        float(keep)
        for pair, keep in zip(checker.pairs, checker.required, strict=True)
        if set(pair) == set(links)
    }


def test_pairs_with_a_constant_distance_are_named(robot: Robot) -> None:
    checker = ClearanceChecker(robot, ground_height=-0.01)
    assert checker.notes == (
        'base_link to link1: not checked, because the distance is 0.003 m in every posture',
        'link1 to ground: not checked, because the distance is 0.035 m in every posture',
    )


def test_links_built_close_together_are_named(example_urdf: Callable[[str], Path]) -> None:
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
    with pytest.raises(ExcitationError, match='link1 to skid overlaps in every posture'):
        ClearanceChecker(with_box(robot, '0.03 0 0.07', '0.02 0.2 0.02', 'skid'))


def test_links_that_overlap_for_good_are_refused(robot: Robot) -> None:
    """Link 4's tool drawn so long that link 2 is inside it in every posture."""
    shape = '<geometry><cylinder radius="0.012" length="0.046"/></geometry>'
    assert shape in robot.urdf_text
    huge = robot.urdf_text.replace(shape, '<geometry><sphere radius="2.0"/></geometry>')
    with pytest.raises(ExcitationError, match='overlaps in every posture: check sizes'):
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
