"""Programs that the page may start; test/nodes/test_view_actions.py starts them."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.ros.page.page_programs import RANDOM, ChildProgram, PageProgramError, PagePrograms


@pytest.fixture
def programs(tmp_path: Path) -> Iterator[PagePrograms]:
    programs = PagePrograms('/', tmp_path, {})
    yield programs
    programs.close()


def test_only_trajectories_of_the_folder_are_offered(
    programs: PagePrograms, tmp_path: Path
) -> None:
    rows = np.zeros((1, 1))
    TrajectoryFile(FourierTrajectory(0.5, np.zeros(1), rows, rows), ('joint1',)).save(
        tmp_path / 'mine.yaml'
    )
    (tmp_path / 'other.yaml').write_text('a: 1\n')
    (tmp_path / 'huge.yaml').write_text('#' * 2_000_000)
    (tmp_path / 'gone.yaml').symlink_to(tmp_path / 'nowhere')
    assert programs.trajectories() == (RANDOM, 'mine.yaml')


@pytest.mark.parametrize(
    'name', ['', '../bag', '/tmp/bag', 'a/b', '.hidden', '-p', 'a b', 'x' * 90]
)
def test_a_bag_name_cannot_leave_the_folder(programs: PagePrograms, name: str) -> None:
    with pytest.raises(PageProgramError, match='invalid bag name'):
        programs.record(name)
    assert not programs.recorder.runs


def test_existing_bags_and_unknown_trajectories_are_rejected(
    programs: PagePrograms, tmp_path: Path
) -> None:
    (tmp_path / 'bag').mkdir()
    with pytest.raises(PageProgramError, match='already exists: choose another name'):
        programs.record('bag')
    with pytest.raises(PageProgramError, match='no trajectory'):
        programs.play('/etc/passwd')
    with pytest.raises(PageProgramError, match='unknown controller'):
        programs.control('arm', 0.5)


CLICKS = 6


def test_clicks_at_the_same_time_start_one_node(ros_domain: dict[str, str], tmp_path: Path) -> None:
    program = ChildProgram('/')
    together = threading.Barrier(CLICKS)
    refused: list[str] = []

    def click() -> None:
        together.wait(60.0)
        try:
            program.start('recorder', {'bag': tmp_path / 'bag'})
        except RuntimeError as error:
            refused.append(str(error))
        together.wait(60.0)  # a node ends with the thread that started it

    threads = [threading.Thread(target=click) for _ in range(CLICKS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    program.close()
    assert refused == ['recorder is already running: stop it first'] * (CLICKS - 1)
