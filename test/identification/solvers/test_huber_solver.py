"""Outliers in the torque hardly move the robust estimate."""

from dataclasses import replace

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import LinkBounds
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify


def test_collisions_do_not_spoil_it(
    arm, robot: Robot, config: ArmConfig, result: IdentificationResult
) -> None:
    bag = arm.recording(1, noise=1.0)
    tau = bag.tau.copy()
    for start in (4.0, 9.0, 13.0, 17.0):
        tau[(bag.time > start) & (bag.time < start + 0.3)] += 4.0
    options = IdentificationOptions(friction='coulomb', solvers=('huber',))
    clean = arm.recording(2, noise=1.0)
    hit = identify(robot, config, [replace(bag, tau=tau)], [clean], options, Stopwatch())
    robust, plain = (hit.solutions[name] for name in ('huber', 'sdp'))
    assert robust.estimate.physically_consistent
    best = result.recommended.validation[0].filtered
    assert robust.validation[0].filtered < 0.5 * plain.validation[0].filtered
    assert robust.validation[0].filtered < 3.0 * best
    assert np.all(robust.estimate.theta[40:] >= 0.0)


def test_the_solution_satisfies_the_bounds_of_the_user(
    arm, robot: Robot, config: ArmConfig, result: IdentificationResult
) -> None:
    true_mass = float(result.recommended.estimate.inertial[:, 0].sum())
    for factor in (0.9, 1.1):
        bounds = LinkBounds(total_mass=(0.999 * factor * true_mass, 1.001 * factor * true_mass))
        options = IdentificationOptions(friction='coulomb', solvers=('huber',), bounds=bounds)
        found = identify(robot, config, [arm.recording(1, noise=1.0)], [], options, Stopwatch())
        for name in ('huber', 'sdp'):
            mass = found.solutions[name].estimate.inertial[:, 0].sum()
            assert abs(mass - factor * true_mass) <= 1.01e-3 * factor * true_mass
