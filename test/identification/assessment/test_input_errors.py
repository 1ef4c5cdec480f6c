"""Each common error of a recording is named, and implausible results say what to check.

The measured arm has bodies of another size and density than drawn, friction, rotors and noise.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.input_errors import bound_warnings, joint_warnings
from aerarm_ros.identification.joint_model import JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording


@pytest.fixture(scope='module')
def recording(make_arm: Callable) -> Recording:
    return make_arm(rate=100.0).recording(1, noise=1.0)


@pytest.mark.parametrize(
    ('factors', 'order', 'degrees', 'words'),
    [
        ((1, 1, 1, 1), (0, 1, 2, 3), (0, 0, 0, 0), ''),
        ((1, -1, 1, 1), (0, 1, 2, 3), (0, 0, 0, 0), 'effort of joint2 has the opposite sign'),
        ((1, 1, -1, 1), (0, 1, 2, 3), (0, 0, 0, 0), 'effort of joint3 has the opposite sign'),
        ((1, 1, 1, 1), (0, 3, 2, 1), (0, 0, 0, 0), '--rename joint2=joint4 joint4=joint2'),
        ((1, 1, 1, 1), (1, 0, 2, 3), (0, 0, 0, 0), '--rename joint1=joint2 joint2=joint1'),
        ((1, 1, 1, 1), (0, 1, 2, 3), (0, 90, 0, 0), 'joint2 is off by +90 degrees'),
        ((1, 1, 1, 1), (0, 1, 2, 3), (0, -90, 0, 0), 'joint2 is off by -90 degrees'),
        ((2, 1, 1, 1), (0, 1, 2, 3), (0, 0, 0, 0), 'the effort of joint1 is 2 times'),
        ((1, 2, 1, 1), (0, 1, 2, 3), (0, 0, 0, 0), 'the effort of joint2 is 2 times'),
    ],
)
def test_the_error_is_named(
    recording: Recording, factors: tuple, order: tuple, degrees: tuple, words: str
) -> None:
    columns = {name: getattr(recording, name)[:, order] for name in ('q', 'dq', 'tau')}
    columns['q'] = columns['q'] + np.radians(degrees)
    columns['tau'] = columns['tau'] * factors
    warnings = identified(replace(recording, **columns)).warnings
    found = [text for text in warnings if 'a simple model leaves' in text]
    assert len(found) == bool(words), warnings
    assert words in ''.join(found)


def test_efforts_in_another_unit(recording: Recording) -> None:
    text = ' '.join(identified(replace(recording, tau=20.0 * recording.tau)).warnings)
    assert 'the effort of joint2 is 2' in text
    assert 'times the modelled torque' in text


def test_bounds_that_hold_an_estimate(result: IdentificationResult) -> None:
    """Masses at half of CAD's, negative friction, and friction that takes all of the load."""
    estimate, fit = result.recommended.estimate, result.fit
    mass, first = estimate.inertial[:, 0], 10 * fit.model.n
    assert bound_warnings(estimate, fit, mass) == []
    (text,) = bound_warnings(estimate, fit, 2.0 * mass)
    assert 'mass of link1, link2, link3, link4 is at its bound, half' in text
    held, wanted = np.array(estimate.theta), np.array(fit.theta)
    held[first], wanted[first] = 0.0, -1.0
    (text,) = bound_warnings(replace(estimate, theta=held), replace(fit, theta=wanted), mass)
    omitted = f'the terms {fit.model.columns[first]} are omitted, because their values are negative'
    assert text.startswith(omitted)
    load = JointTerm(TermKind.LOAD)
    terms = tuple((load, *own) if joint == 1 else own for joint, own in enumerate(fit.model.terms))
    model = replace(fit.model, terms=terms)
    index = model.columns.index('fl_joint2')
    theta, std = (np.insert(values, index, 1.0) for values in (estimate.theta, estimate.std))
    full = replace(estimate, model=model, theta=theta, std=std)
    (text,) = bound_warnings(full, replace(fit, model=model, theta=theta), mass)
    assert text.startswith('the load-dependent friction fl_joint2 is at its upper bound 1')


def test_a_joint_that_only_validation_fails_to_predict(result: IdentificationResult) -> None:
    solution, joints = result.recommended, result.robot.joint_names
    assert joint_warnings(solution, joints) == []
    poor = [replace(b, per_joint_filtered=np.array([1, 2, 35, 4])) for b in solution.validation]
    (text,) = joint_warnings(replace(solution, validation=poor), joints)
    assert 'exceeds 20 % in validation (joint3 35 %)' in text
    assert joint_warnings(replace(solution, validation=[]), joints) == []


def test_a_joint_that_another_one_drives(make_arm: Callable) -> None:
    """The residual says whose motion it follows, until the coupling is given."""
    plain = make_arm(rate=100.0).recording(1)
    recording = replace(plain, tau=plain.tau + 8.0 * plain.dq[:, [1]] * [0.0, 0.0, 0.0, 1.0])
    for coupled, said in (((), True), ((('joint4', 'joint2'),), False)):
        text = ' '.join(identified(recording, coupled=coupled).warnings)
        assert ('--coupled joint4=joint2' in text) == said
        assert ('of some joints exceeds 20 % (joint4' in text) == said
