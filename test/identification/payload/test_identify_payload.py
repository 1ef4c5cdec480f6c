"""A payload is weighed by moving it."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.payload import identify_payload
from aerarm_ros.model.inertia import from_pseudo_inertia, is_physically_consistent

MASS, CENTRE = 0.2, np.array([0.1, 0.01, -0.02])


def body() -> np.ndarray:
    point = np.append(CENTRE, 1.0)
    matter = MASS * (np.outer(point, point) + np.diag([2e-4, 3e-4, 4e-4, 0.0]))
    return from_pseudo_inertia(matter)


def loaded(arm):
    inertial = arm.inertial.copy()
    inertial[-1] += body()
    return replace(arm, inertial=inertial)


@pytest.mark.parametrize('seed', [2, 3])
def test_a_fifth_of_a_kilogram_is_found(arm, result: IdentificationResult, seed: int) -> None:
    payload = identify_payload(result, [loaded(arm).recording(seed, noise=1.0)])
    assert payload.link == 'link4'
    assert payload.mass == pytest.approx(MASS, rel=0.02)
    assert payload.centre == pytest.approx(CENTRE, abs=5e-3)
    assert is_physically_consistent(payload.inertial)
    deviations = (payload.inertial - body()) / payload.std
    assert np.abs(deviations).max() < 5.0
    assert np.all(payload.centre_std < 0.01)


def test_an_empty_hand_is_no_payload(arm, result: IdentificationResult) -> None:
    with pytest.raises(IdentificationError, match='no payload found'):
        identify_payload(result, [arm.recording(2, noise=1.0)])
