"""Joules of a bag, against those of the simulated arm's exact torques and motion."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.energy.energy_model import DrivePower, EnergyBalance
from aerarm_ros.identification.identification_result import bag_energies
from aerarm_ros.identification.report.report import ReportExtras, report_html


@pytest.fixture(scope='module')
def balances(result, config) -> dict[str, EnergyBalance]:
    return bag_energies(config, result)


def test_they_are_the_joules_of_the_exact_motion(balances, result, arm, config) -> None:
    samples = result.validation[0].samples
    balance = balances['bag2']
    t, q, dq, ddq = arm.motion(2)
    tau = arm.torque(q, dq, ddq)
    within = (t >= samples.time[samples.kept][0]) & (t <= samples.time[samples.kept][-1])
    seconds = balance.seconds
    assert seconds == pytest.approx(within.sum() * (t[1] - t[0]), rel=0.02)
    drives = DrivePower(config)

    def joules(power: np.ndarray) -> np.ndarray:
        return power[within].mean(axis=0) * seconds

    friction = (arm.viscous * dq + arm.coulomb * np.sign(dq)) * dq
    supplied = drives.from_supply(drives.electrical(tau, dq))
    for mine, true in (
        (balance.copper, joules(drives.copper(tau))),
        (balance.friction, joules(friction)),
        (balance.motors, joules(supplied)),
    ):
        assert mine.sum() == pytest.approx(true.sum(), rel=0.03)
    assert abs(balance.unexplained.sum()) < 0.01 * balance.motors.sum()


def test_the_report_lists_energies_and_resistances_per_joint(balances, result) -> None:
    used = {'joint1': '0.1 (an estimate)', 'joint2': '0.171 (± 0.002)'}
    page = report_html(result, ReportExtras(energy=balances, resistances=used))
    assert 'joint1 0.1 (an estimate); joint2 0.171 (± 0.002).' in page
    assert '>Energy</h2>' in page
    assert 'copper [J]' in page
    assert '<h2>Energy</h2>' not in report_html(result, ReportExtras())


def test_motors_of_another_arm_say_nothing(result, config) -> None:
    assert bag_energies(config.with_prefix('left_'), result) == {}
    assert replace(config).joint_names == result.robot.joint_names
