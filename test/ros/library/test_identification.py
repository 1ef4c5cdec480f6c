"""The interface for programs: arrays or bags as input, an identified arm with errors as output."""

import json
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from identifier_process import measured, motion, write_bag

import aerarm_ros
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identify import IdentificationOptions
from aerarm_ros.ros.library.identification import IdentifiedArm

OPTIONS = IdentificationOptions(friction='coulomb')


@pytest.fixture(scope='module')
def arrays() -> tuple[np.ndarray, ...]:
    stamp, q, dq, ddq = motion(1)
    return stamp, q, dq, measured(aerarm_ros.load_robot(), q, dq, ddq)


@pytest.fixture(scope='module')
def arm(arrays: tuple[np.ndarray, ...]) -> IdentifiedArm:
    """Identified from lists."""
    stamp, q, dq, tau = (values.tolist() for values in arrays)
    return aerarm_ros.identify(
        aerarm_ros.from_arrays(stamp, q, tau, dq), holdout=0.4, options=OPTIONS
    )


def test_three_calls_from_a_bag_to_a_model(
    arrays: tuple[np.ndarray, ...], arm: IdentifiedArm, tmp_path: Path
) -> None:
    stamp, q, dq, tau = arrays
    path = write_bag(tmp_path / 'bag', stamp, (q, dq, tau))
    states = aerarm_ros.read_bag(path)
    assert states.position == pytest.approx(q)
    assert states.effort == pytest.approx(tau)
    for bag in (path, states):
        found = aerarm_ros.identify([bag], holdout=0.4, options=OPTIONS)
        assert found.parameters == pytest.approx(arm.parameters, rel=1e-4, abs=1e-6)


def test_the_result_states_its_torque_error(arm: IdentifiedArm) -> None:
    assert arm.errors[0].filtered < 0.2 * arm.result.solutions['cad'].validation[0].filtered
    assert f'{arm.errors[0].filtered:.2f} % filtered' in repr(arm)
    text = arm.summary()
    assert [line.split()[0] for line in text.splitlines()[3:8]] == [
        *('cad', 'cad_friction', 'ols', 'wls', 'sdp')
    ]
    assert arm.as_dict()['joints'] == ['joint1', 'joint2', 'joint3', 'joint4']
    assert set(arm.parameters) == set(arm.estimate.model.columns)
    page = HTMLParser()
    page.feed(arm._repr_html_())
    assert 'fv_joint3' in arm._repr_html_()


def test_its_torque_is_that_of_the_assessment(arm: IdentifiedArm) -> None:
    (bag,) = arm.result.identification
    samples = bag.samples
    torque = arm.torque(samples.q, samples.dq, samples.ddq)
    np.testing.assert_allclose(torque, bag.predict(arm.estimate.model, arm.estimate.theta).raw)
    row = arm.torque(samples.q[7].tolist(), samples.dq[7], samples.ddq[7])
    np.testing.assert_allclose(row, torque[7])
    with pytest.raises(ValueError, match=r'\(3,\): pass arrays of shape \(4,\) or \(M, 4\)'):
        arm.torque(samples.q[7], samples.dq[7], samples.ddq[7][:3])
    assert len(repr(arm.errors)) < 300


def test_the_result_is_saved_as_by_the_identifier(arm: IdentifiedArm, tmp_path: Path) -> None:
    folder = arm.save(tmp_path / 'result')
    assert sorted(path.name for path in folder.iterdir()) == [
        *('estimate.yaml', 'identified.sdf', 'identified.urdf', 'identified.xml'),
        *('report.html', 'summary.json'),
    ]
    assert json.loads((folder / 'summary.json').read_text()) == json.loads(
        json.dumps(arm.as_dict())
    )
    assert arm.save(folder) == folder


TIME, POSITION = np.arange(5.0), np.zeros((5, 4))


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ([POSITION] * 3, r'time has the shape \(5, 4\): pass an array of shape \(any\)'),
        ((TIME, POSITION[:4], POSITION), r'q has the shape \(4, 4\): pass .* \(5, any\)'),
        ((TIME, POSITION, POSITION[:, :3]), r'tau has the shape \(5, 3\): pass .* \(5, 4\)'),
        ((TIME, POSITION, [[1.0], [2.0, 3.0]]), 'tau is not an array of numbers: pass numbers'),
        ((TIME, POSITION, POSITION, None, 'ab'), 'q has 4 columns, but names has 2 joint names'),
    ],
)
def test_shapes_are_checked_with_a_sentence(arguments: Sequence, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        aerarm_ros.from_arrays(*arguments)


@pytest.mark.parametrize(
    ('bags', 'options', 'words'),
    [
        ([], {'holdout': 1.5}, 'holdout = 1.5'),
        ([], {}, 'the argument bags is empty: pass at least one'),
        (POSITION, {}, 'is neither a path nor a motion'),
        (5, {}, 'is neither a path nor a motion'),
        (None, {}, 'is neither a path nor a motion'),
        ('bag', {'urdf': aerarm_ros.load_robot(), 'lock': 'joint1'}, r'robot\(urdf, locked='),
    ],
)
def test_faulty_arguments_are_named(bags: object, options: dict, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        aerarm_ros.identify(bags, **options)
