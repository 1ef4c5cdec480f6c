"""Acceleration runs tell the inertia once the steps have told the rest."""

from dataclasses import replace

import numpy as np
import pytest
from motor_data import INERTIA, acceleration, steps

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_bench import fit_inertia
from aerarm_ros.identification.motor_bench.motor_friction import fit_motor_friction


def test_inertia_under_gravity_and_friction() -> None:
    friction = fit_motor_friction(steps(), mounted=True, name='j')
    inertia, std = fit_inertia([acceleration()], friction, 'j')
    assert inertia == pytest.approx(INERTIA, rel=0.02)
    assert 0.0 < std < 0.05 * INERTIA


def test_runs_that_tell_nothing_are_named() -> None:
    friction = fit_motor_friction(steps(), mounted=True, name='j')
    with pytest.raises(IdentificationError, match='elbow: the acceleration runs are shorter'):
        fit_inertia([], friction, 'elbow')
    run = acceleration()  # ddq = -pi^2 q
    with pytest.raises(IdentificationError, match='elbow: the measured inertia'):
        fit_inertia(
            [replace(run, tau=run.tau + 2.0 * INERTIA * np.pi**2 * run.q)], friction, 'elbow'
        )
