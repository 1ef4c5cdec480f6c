"""Each fault of the measurements yields one error that names the fault."""

from dataclasses import replace

import numpy as np
import pytest
from measured_arm import CONFIG, LINK, ROBOT, MeasuredArm, own_chain

from aerarm_ros.calibration.calibrate import HeldOut, calibrate
from aerarm_ros.calibration.chain import chain_of
from aerarm_ros.calibration.choice import LEVELS, check_offsets, identifiable
from aerarm_ros.calibration.fit import fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import (
    CalibrationError,
    MarkerSource,
    Observations,
    PlaneSource,
    PoseSource,
)
from aerarm_ros.simulation.made_geometry import displaced_urdf


@pytest.fixture(scope='module')
def good() -> Observations:
    arm = MeasuredArm(2, frames=5)
    return arm.observe(arm.postures(30))


def changed(good: Observations, position: np.ndarray, names: tuple[str, ...] = ()) -> Observations:
    source = good.sources[0]
    assert isinstance(source, MarkerSource)
    names = names or source.names
    return replace(good, sources=(replace(source, position=position, names=names),))


def positions(good: Observations) -> np.ndarray:
    source = good.sources[0]
    assert isinstance(source, MarkerSource)
    return source.position.copy()


def refused(observations: Observations) -> str:
    with pytest.raises(CalibrationError) as error:
        calibrate(own_chain(), observations)
    assert '\n' not in str(error.value)
    return str(error.value)


def test_swapped_markers_are_named_with_the_posture(good: Observations) -> None:
    position = positions(good)
    position[4, [0, 2]] = position[4, [2, 0]]
    text = refused(changed(good, position))
    assert 'posture 5: markers marker1 and marker3 are swapped' in text


def test_validation_postures_are_checked_too(good: Observations) -> None:
    swapped = positions(good)
    swapped[4, [0, 2]] = swapped[4, [2, 0]]
    for position, fault in (
        (swapped, 'markers marker1 and marker3 are swapped'),
        (1e3 * positions(good), 'positions look like millimetres'),
    ):
        with pytest.raises(CalibrationError, match=fault):
            calibrate(own_chain(), good, [HeldOut('other day', changed(good, position))])


def test_two_markers_alone_are_found_swapped_by_the_motion_of_the_arm(good: Observations) -> None:
    position = positions(good)[:, :2]
    position[4] = position[4, ::-1]
    text = refused(changed(good, position, ('a', 'b')))
    assert 'posture 5: markers a and b are swapped' in text


def test_a_jumping_marker_is_named(good: Observations) -> None:
    position = positions(good)
    rows = np.flatnonzero(np.isfinite(position[..., 0]).all(axis=1))[1:3]
    position[rows, 1] += 0.04
    text = refused(changed(good, position))
    assert f'posture {rows[0] + 1} (and in 1 more): marker marker2 jumps by' in text


def test_a_jump_of_the_only_marker_is_found_by_the_other_postures(good: Observations) -> None:
    position = positions(good)[:, :1]
    position[3] += 0.12
    text = refused(changed(good, position, ('tip',)))
    assert 'posture 4: marker tip jumps by 2' in text and 'relative to the other postures' in text


def test_millimetres_are_suspected(good: Observations) -> None:
    text = refused(changed(good, 1e3 * positions(good)))
    assert 'look like millimetres; pass --length-unit mm' in text


def test_degrees_are_suspected(good: Observations) -> None:
    text = refused(replace(good, q=np.degrees(good.q)))
    assert 'positions look like degrees; pass --degrees' in text


def test_a_jumping_marker_is_named_if_another_is_hidden(good: Observations) -> None:
    position = positions(good)[:, :3]
    row = int(np.flatnonzero(np.isfinite(position[..., 0]).all(axis=1))[0])
    position[row, 0] += 0.04
    position[row, 2] = np.nan
    text = refused(changed(good, position, ('a', 'b', 'c')))
    assert f'posture {row + 1}: marker a or b jumps by' in text and 'nan' not in text


def test_a_marker_that_was_never_seen_is_named(good: Observations) -> None:
    position = positions(good)
    position[:, 3] = np.nan
    text = refused(changed(good, position))
    assert text == 'marker4 has no measurement in any posture: pass --ignore marker4'


def test_a_plane_without_contacts_is_named(good: Observations) -> None:
    plane = PlaneSource('table', np.zeros(len(good)))
    text = refused(replace(good, sources=(*good.sources, plane)))
    assert text == 'table has no measurement in any posture: pass --ignore table'


def test_a_fit_ignores_a_source_without_measurements_in_its_postures(good: Observations) -> None:
    touches = np.zeros(len(good))
    touches[:8] = 1.0
    start = registered(
        ArmGeometry(ROBOT, LINK), replace(good, sources=(PlaneSource('table', touches),))
    )
    fit = fitted(start, (), start.observations.rows(range(8, 30)))
    assert fit.repeats == 1.0 and np.isfinite(fit.length)


def test_a_pose_without_rotations_is_named(good: Observations) -> None:
    rotation = np.full((len(good), 3, 3), np.nan)
    pose = PoseSource('camera', rotation, positions(good)[:, 0])
    text = refused(replace(good, sources=(*good.sources, pose)))
    assert text == 'camera has no measurement in any posture: pass --ignore camera'


def test_validation_without_a_source_names_it(good: Observations) -> None:
    plane = PlaneSource('table', np.ones(len(good)))
    both = replace(good, sources=(plane, *good.sources))
    with pytest.raises(CalibrationError) as error:
        calibrate(own_chain(), both, [HeldOut('other', good)])
    assert str(error.value) == (
        'the held-out postures other have no measurements of table: add measurements, or pass '
        '--ignore table'
    )


def test_too_few_postures_are_counted(good: Observations) -> None:
    assert refused(good.rows(range(5))).startswith('only 5 postures have measurements')


def test_postures_in_which_a_joint_rests_name_the_offset_that_they_hide() -> None:
    arm = MeasuredArm(2, frames=5)
    q = arm.postures(30)
    q[:, 2:] = (0.3, -0.4)
    text = refused(arm.observe(q))
    assert '.offset cannot be estimated' in text
    assert 'too few or too similar: move every joint further, above all joint3, joint4' in text


def test_too_similar_postures_name_the_uncertain_parameters() -> None:
    arm = MeasuredArm(2)
    q = 0.004 * arm.postures(30) + (0.2, 1.0, 0.3, 0.4)
    text = refused(arm.observe(q))
    assert 'cannot be estimated' in text and 'too similar' in text


@pytest.mark.parametrize(('span', 'share'), [(0.06, 0.85), (0.1, 0.71)])
def test_an_offset_above_80_percent_of_its_prior_deviation_is_named(
    span: float, share: float
) -> None:
    arm = MeasuredArm(2)
    observations = arm.observe(span * arm.postures(30) + (0.2, 1.0, 0.3, 0.4))
    source = observations.sources[0]
    assert isinstance(source, MarkerSource)
    error = 1e-3 * np.random.default_rng(0).normal(size=(30, 1, 3))
    observations = changed(observations, source.position + error)
    start = registered(ArmGeometry(ROBOT, LINK), observations)
    found = identifiable(start, LEVELS['offsets'])
    fit = fitted(start, found.columns)
    typical = start.geometry.typical[list(fit.free)]
    assert max(fit.deviations[: len(fit.free)] / typical) == pytest.approx(share, abs=0.02)
    if share < 0.8:
        assert not check_offsets(start, found)
        return
    with pytest.raises(CalibrationError, match='joint3.offset cannot be estimated'):
        check_offsets(start, found)


def test_a_wrong_urdf_is_refused(good: Observations) -> None:
    shifts = np.zeros((4, 3))
    shifts[3] = (0.0, 0.0, 0.25)  # a forearm twice as long
    text = displaced_urdf(ROBOT.urdf_text, ROBOT.joint_names, shifts, np.zeros((4, 3)))
    chain = chain_of(text, ROBOT.joint_names, '', (), CONFIG.gravity_in_base)
    with pytest.raises(CalibrationError, match='the URDF does not describe this arm'):
        calibrate(chain, good)


def test_a_joint_that_turns_the_other_way_is_named(good: Observations) -> None:
    q = good.q.copy()
    q[:, 2] = -q[:, 2]
    assert 'joint joint3 may turn in the opposite direction' in refused(replace(good, q=q))


def test_copies_of_a_marker_are_left_out_with_a_message(good: Observations) -> None:
    position = positions(good)
    position = np.concatenate([position, position[:, 2:3]], axis=1)
    names = ('a', 'b', 'c', 'd', 'e')
    found = calibrate(own_chain(), changed(good, position, names))
    assert 'marker e has the same values as c in every posture and is ignored' in found.messages


def test_a_missing_joint_position_is_named(good: Observations) -> None:
    q = good.q.copy()
    q[2, 1] = np.nan
    assert refused(replace(good, q=q)).startswith('posture 3 has no position of joint joint2')


@pytest.mark.parametrize(
    ('recorded', 'link', 'expected'),
    [
        (('a', 'b'), '', 'none of the recorded joints (a, b) is a joint of the URDF'),
        (
            ('joint1', 'joint2', 'joint4'),
            'link4',
            'joint joint3 moves link link4, but has no recorded positions',
        ),
        (ROBOT.joint_names, 'tool7', 'link tool7 (--link) is unknown'),
        (ROBOT.joint_names, 'base_link', 'no recorded joint moves link'),
    ],
)
def test_a_wrong_chain_is_one_error(recorded: tuple[str, ...], link: str, expected: str) -> None:
    with pytest.raises(CalibrationError) as error:
        chain_of(ROBOT.urdf_text, recorded, link)
    assert expected in str(error.value)


def test_joints_outside_the_chain_are_ignored() -> None:
    chain = chain_of(ROBOT.urdf_text, (*ROBOT.joint_names, 'gripper'), 'link2')
    assert chain.robot.joint_names == ROBOT.joint_names[:2]
    assert chain.ignored == (*ROBOT.joint_names[2:], 'gripper')
