"""Boxes stand where the links are."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.report.report import inertia_view
from aerarm_ros.model.kinematics import Kinematics


def traces(result: IdentificationResult) -> list[dict]:
    (arguments,) = re.findall(r'Plotly\.newPlot\((.*)\)\);', inertia_view(result))
    return json.loads(f'[{arguments}]')[1]


def test_every_link_has_a_box_before_and_after(result: IdentificationResult) -> None:
    arm, *boxes = traces(result)
    assert arm['text'] == ['base', *result.robot.joint_names]
    assert [box['name'] for box in boxes] == ['before: CAD'] * 4 + ['after: sdp'] * 4
    q = result.identification[0].samples.q.mean(axis=0)
    for link, box, pi in zip(result.robot.link_names, boxes[:4], result.cad.inertial, strict=True):
        pose = Kinematics(result.robot, link).transform(q)
        centre = np.mean([box[axis] for axis in 'xyz'], axis=1)
        assert centre == pytest.approx(pose[:3, :3] @ pi[1:4] / pi[0] + pose[:3, 3], abs=1e-4)


def test_triangles_close_each_box(result: IdentificationResult) -> None:
    box = traces(result)[1]
    corners = np.array([box[axis] for axis in 'xyz']).T
    a, b, c = (corners[box[key]] for key in 'ijk')
    middle = corners.mean(axis=0)
    volume = np.einsum('ij,ij->i', np.cross(a - middle, b - middle), c - middle) / 6.0
    edges = [np.linalg.norm(corners[0] - corners[other]) for other in (1, 2, 4)]
    assert abs(volume.sum()) == pytest.approx(np.prod(edges), rel=1e-2)
    assert np.all(np.sign(volume) == np.sign(volume[0]))


def test_impossible_links_have_no_inertia_box(result: IdentificationResult) -> None:
    wrong = np.array(result.cad.inertial)
    wrong[2, 4:] = 0.0
    changed = replace(result, cad=replace(result.cad, inertial=wrong))
    assert len(traces(changed)) == 1 + 3 + 4
