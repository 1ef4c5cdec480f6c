"""Each fault of the measurements yields one error that names the fault."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from measured_arm import CONFIG, LINK, ROBOT, MeasuredArm, own_chain

from aerarm_ros.calibration.calibrate import calibrate
from aerarm_ros.calibration.chain import chain_of
from aerarm_ros.calibration.checks import without_copies
from aerarm_ros.calibration.fit import fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import (
    CalibrationError,
    MarkerSource,
    Observations,
    PoseSource,
)
from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.made_geometry import displaced_urdf

UNSEEN = 'has no measurement in any posture: pass --ignore'


@pytest.fixture(scope='module')
def good() -> Observations:
    arm = MeasuredArm(2, frames=5)
    return arm.observe(arm.postures(30))


def changed(good: Observations, position: Array) -> Observations:
    """Return observations with the first markers at other positions (M, K, 3)."""
    source = replace(markers(good), position=position, names=tuple('abcde'[: position.shape[1]]))
    return replace(good, sources=(source,))


def markers(good: Observations) -> MarkerSource:
    source = good.sources[0]
    assert isinstance(source, MarkerSource)
    return source


def complete(position: Array) -> Array:
    """Return the numbers of the postures in which all markers are visible."""
    return np.flatnonzero(np.isfinite(position[..., 0]).all(axis=1))


def refused(observations: Observations) -> str:
    with pytest.raises(CalibrationError) as error:
        calibrate(own_chain(), observations)
    assert '\n' not in str(error.value)
    return str(error.value)


def swapped(position: Array) -> Array:
    position[4, [0, 2]] = position[4, [2, 0]]
    return position


def only_two_swapped(position: Array) -> Array:
    position[4, :2] = position[4, 1::-1]
    return position[:, :2]


def one_jumps_twice(position: Array) -> Array:
    position[complete(position)[1:3], 1] += 0.04
    return position


def the_only_one_jumps(position: Array) -> Array:
    position[3, 0] += 0.12
    return position[:, :1]


def one_jumps_beside_a_hidden_one(position: Array) -> Array:
    row = complete(position)[0]
    position[row, 0] += 0.04
    position[row, 2] = np.nan
    return position[:, :3]


def one_was_never_seen(position: Array) -> Array:
    position[:, 3] = np.nan
    return position


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        (swapped, 'posture 5: markers a and c are swapped'),
        (only_two_swapped, 'posture 5: markers a and b are swapped'),
        (one_jumps_twice, '(and in 1 more): marker b jumps by'),
        (the_only_one_jumps, 'posture 4: marker a jumps by 2'),
        (one_jumps_beside_a_hidden_one, ': marker a or b jumps by'),
        (one_was_never_seen, f'd {UNSEEN} d'),
        (lambda position: 1e3 * position, 'look like millimetres; pass --length-unit mm'),
    ],
)
def test_a_fault_of_markers_is_named(
    good: Observations, change: Callable[[Array], Array], expected: str
) -> None:
    position = change(markers(good).position.copy())
    text = refused(changed(good, position))
    assert expected in text and 'nan' not in text


def test_held_out_postures_are_checked_too(good: Observations) -> None:
    whole = changed(good, markers(good).position)
    held = changed(good, swapped(markers(good).position.copy()))
    with pytest.raises(CalibrationError, match='are swapped'):
        calibrate(own_chain(), whole, {'other day': held})


def test_joint_positions_in_degrees_missing_or_reversed_are_named(good: Observations) -> None:
    assert 'pass --degrees' in refused(replace(good, q=np.degrees(good.q)))
    q = good.q.copy()
    q[2, 1] = np.nan
    assert refused(replace(good, q=q)).startswith('posture 3 has no position of joint joint2')
    q = good.q * np.array([1.0, 1.0, -1.0, 1.0])
    assert 'joint joint3 may turn in the opposite direction' in refused(replace(good, q=q))
    assert refused(good.rows(range(5))).startswith('only 5 postures have measurements')


def test_a_source_without_measurements_is_named(good: Observations) -> None:
    rotation, position = np.full((len(good), 3, 3), np.nan), markers(good).position[:, 0]
    camera = PoseSource('camera', rotation, position)
    text = refused(replace(good, sources=(*good.sources, camera)))
    assert text == f'camera {UNSEEN} camera'
    seen = replace(camera, rotation=np.tile(np.eye(3), (len(good), 1, 1)))
    both = replace(good, sources=(seen, *good.sources))
    with pytest.raises(CalibrationError, match='other have no measurements of camera: .*--ignore'):
        calibrate(own_chain(), both, {'other': good})


def test_a_fit_ignores_a_source_without_measurements_in_its_postures(good: Observations) -> None:
    rotation = np.tile(np.eye(3), (len(good), 1, 1))
    rotation[8:] = np.nan
    camera = PoseSource('camera', rotation, markers(good).position[:, 0])
    start = registered(ArmGeometry(ROBOT, LINK), replace(good, sources=(camera,)))
    fit = fitted(start, (), start.observations.rows(range(8, 30)))
    assert fit.repeats == 1.0 and np.isfinite(fit.length)


def test_postures_in_which_a_joint_rests_name_the_offset_that_they_hide() -> None:
    arm = MeasuredArm(2, frames=5)
    q = arm.postures(30)
    q[:, 2:] = (0.3, -0.4)
    text = refused(arm.observe(q))
    assert '.offset cannot be estimated' in text
    # Postures so alike that the prior outweighs the measurements.
    whole = arm.observe(0.06 * arm.postures(30) + (0.2, 1.0, 0.3, 0.4))
    error = 1e-3 * np.random.default_rng(0).normal(size=(30, 1, 3))
    assert 'joint3.offset cannot be estimated' in refused(
        changed(whole, markers(whole).position + error)
    )
    assert 'too few or too similar: move every joint further, above all joint3, joint4' in text


def test_a_wrong_urdf_is_refused(good: Observations) -> None:
    shifts = np.zeros((4, 3))
    shifts[3] = (0.0, 0.0, 0.25)  # a forearm twice as long
    text = displaced_urdf(ROBOT.urdf_text, ROBOT.joint_names, shifts, np.zeros((4, 3)))
    chain = chain_of(text, ROBOT.joint_names, '', (), CONFIG.gravity_in_base)
    with pytest.raises(CalibrationError, match='the URDF does not describe this arm'):
        calibrate(chain, good)


def test_copies_of_a_marker_are_left_out_with_a_message(good: Observations) -> None:
    position = markers(good).position
    position = np.concatenate([position, position[:, 2:3]], axis=1)
    kept, messages = without_copies(markers(changed(good, position)))
    assert kept.names == tuple('abcd')
    assert messages == ['marker e has the same values as c in every posture and is ignored']


@pytest.mark.parametrize(
    ('recorded', 'link', 'expected'),
    [
        (('a', 'b'), '', r'none of the recorded joints \(a, b\) is a joint of the URDF'),
        (('joint1', 'joint2', 'joint4'), 'link4', 'joint joint3 moves link link4, but has no'),
        (ROBOT.joint_names, 'tool7', r'link tool7 \(--link\) is unknown'),
        (ROBOT.joint_names, 'base_link', 'no recorded joint moves link'),
    ],
)
def test_a_wrong_chain_is_one_error(recorded: tuple[str, ...], link: str, expected: str) -> None:
    with pytest.raises(CalibrationError, match=expected):
        chain_of(ROBOT.urdf_text, recorded, link)
    chain = chain_of(ROBOT.urdf_text, (*ROBOT.joint_names, 'gripper'), 'link2')
    assert chain.robot.joint_names == ROBOT.joint_names[:2]
    assert chain.ignored == (*ROBOT.joint_names[2:], 'gripper')
