"""One complete page that needs no network."""

import re
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.preview import ArmAnimation, Preview
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner
from aerarm_ros.model.kinematics import Kinematics


@pytest.fixture(scope='module')
def preview(designer: TrajectoryDesigner, designed: DesignResult) -> Preview:
    return Preview(designer, designed, designer.initial(0))


def test_page_is_complete_and_self_contained(preview: Preview, tmp_path: Path) -> None:
    path = tmp_path / 'preview.html'
    preview.write(path)
    page = path.read_text()
    for title in ('Trajectory', 'Workspace', 'Excitation of each parameter', 'Animation'):
        assert f'>{title}</h2>' in page
    assert 'ground clearance' in page
    assert not re.search(r'<(script|link|img)[^>]*(src|href)="https?:', page)
    assert len(page) < 3_000_000


def test_unwritable_page_is_an_error(preview: Preview, tmp_path: Path) -> None:
    with pytest.raises(ExcitationError, match='cannot be written'):
        preview.write(tmp_path / 'nowhere' / 'preview.html')


def test_the_tool_path_is_that_of_the_kinematics(setup: ExcitationSetup, robot) -> None:
    animation = ArmAnimation(robot, setup.clearance)
    assert animation.tool_name == 'tool0'
    q = np.array([[0.3, 1.2, -0.4, 0.5]])
    np.testing.assert_allclose(
        animation.tool_path(q)[0], Kinematics(robot, 'tool0').position(q[0]), atol=1e-12
    )
