"""One complete page that needs no network."""

import re
from pathlib import Path

import pytest

from aerarm_ros.excitation.preview import Preview
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner


@pytest.fixture(scope='module')
def preview(designer: TrajectoryDesigner, designed: DesignResult) -> Preview:
    return Preview(designer, designed, designer.initial(0))


def test_page_is_complete_and_self_contained(preview: Preview, tmp_path: Path) -> None:
    path = tmp_path / 'preview.html'
    preview.write(path)
    page = path.read_text()
    for title in ('Trajectory', 'Workspace', 'Excitation of each parameter'):
        assert f'>{title}</h2>' in page
    assert 'ground clearance' in page and 'Path of tool0 ' in page
    assert not re.search(r'<(script|link|img)[^>]*(src|href)="https?:', page)
    assert len(page) < 3_000_000


def test_unwritable_page_is_an_error(preview: Preview, tmp_path: Path) -> None:
    with pytest.raises(ExcitationError, match='cannot be written'):
        preview.write(tmp_path / 'nowhere' / 'preview.html')
