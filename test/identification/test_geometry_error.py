"""What a millimetre of wrong geometry costs in torque."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.identification_result import (
    IdentificationResult,
    geometry_text,
    is_calibrated,
    torque_error_per_millimetre,
)


def test_the_cost_of_1_mm_is_that_of_random_displacements() -> None:
    robot = load_robot()
    random = np.random.default_rng(1)
    q, dq, ddq = (random.normal(size=(40, 4)) * s for s in (1.0, 1.0, 3.0))
    expected = torque_error_per_millimetre(robot, q, dq, ddq)
    nominal = np.array([pin.rnea(robot.model, robot.model.createData(), *s) for s in
                        zip(q, dq, ddq, strict=True)])  # fmt: skip
    found = []
    for _ in range(60):
        model = robot.model.copy()
        for joint in range(2, 5):
            placement = model.jointPlacements[joint]
            shift = pin.SE3(np.eye(3), 1e-3 * random.normal(size=3))
            model.jointPlacements[joint] = shift * placement
        data = model.createData()
        torque = np.array([pin.rnea(model, data, *s).copy() for s in zip(q, dq, ddq, strict=True)])
        found.append(np.sum((torque - nominal) ** 2) / np.sum(nominal**2))
    assert expected == pytest.approx(100.0 * np.sqrt(np.mean(found)), rel=0.15)
    assert 0.05 < expected < 2.0


def test_a_calibrated_urdf_is_recognized() -> None:
    text = load_robot().urdf_text
    assert not is_calibrated(load_robot(text[text.index('<robot') :]))
    assert is_calibrated(load_robot(text.replace('<robot', '<!-- calibrated geometry: x --><robot')
                                    [text.index('<robot') :]))  # fmt: skip


def test_the_report_of_an_identification_names_the_torque_error_of_1_mm(
    result: IdentificationResult,
) -> None:
    text = geometry_text(result)
    assert text.startswith('The geometry of the URDF was not calibrated. An error of 1 mm')
    assert 0.05 < float(text.split(' %')[0].rsplit(' ', 1)[1]) < 5.0
    urdf = result.robot.urdf_text
    place = urdf.index('<robot')
    calibrated = load_robot(f'<!-- calibrated geometry: x -->{urdf[place:]}')
    assert geometry_text(replace(result, robot=calibrated)) == (
        'The geometry of the URDF is calibrated.'
    )
