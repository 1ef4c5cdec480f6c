"""`identifier --each`: one row per bag, stored at once, and equal for any kind of run."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identifier_process import measured, motion

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.nodes.identifier import main
from aerarm_ros.ros.programs.fleet_run import find_bags

OPTIONS = ('--friction', 'coulomb', '--holdout', '0.4', '--exact-stamps', '--cutoff', '4')


def write_table(path: Path, seed: int) -> None:
    _, q, dq, ddq = motion(seed)
    tau = measured(load_robot(), q, dq, ddq)
    path.parent.mkdir(parents=True, exist_ok=True)
    time = 1.7e9 + 1e5 * seed + np.arange(len(q)) / 200.0
    np.savez(path, time=time[::2], q=q[::2], dq=dq[::2], tau=tau[::2])


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three good tables of two arms, and one without any motion."""
    folder = tmp_path_factory.mktemp('fleet')
    for arm, name, seed in (('left', 'a', 1), ('left', 'b', 2), ('right', 'a', 3)):
        write_table(folder / arm / f'{name}.npz', seed)
    still = np.ones((9, 4))
    np.savez(folder / 'right' / 'still.npz', time=np.arange(9.0), q=still, tau=still)
    return folder


def run(*arguments: object) -> int:
    return main([*map(str, arguments), *OPTIONS])


def rows(out: Path) -> list[dict[str, str]]:
    with (out / 'fleet.csv').open(newline='') as file:
        return list(csv.DictReader(file))


def comparable(table: list[dict[str, str]]) -> list[dict[str, str]]:
    return [{k: v for k, v in row.items() if k != 'seconds'} for row in table]


@pytest.fixture(scope='module')
def out(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp('out') / 'table'
    assert run('--each', folder, '--workers', 2, '--out', out) == 0
    return out


def test_every_bag_is_a_row_with_its_arm_and_errors(out: Path) -> None:
    table = rows(out)
    assert [Path(row['bag']).name for row in table] == ['a.npz', 'b.npz', 'a.npz', 'still.npz']
    assert [row['arm'] for row in table] == ['left', 'left', 'right', 'right']
    assert [row['status'] for row in table] == ['ok', 'ok', 'ok', 'failed']
    assert 'IdentificationError' in table[3]['reason']
    assert table[0]['date'].startswith('2023-11-1')
    for row in table[:3]:
        assert float(row['validation_sdp_filtered']) < 5.0
        assert float(row['validation_cad_friction_filtered']) > 5.0
        assert float(row['fs_joint2']) == pytest.approx(0.2, abs=0.03)
        assert 0.0 < float(row['fs_joint2_std']) < 0.03
    assert '3 of 4 bags of 2 arms were identified' in (out / 'fleet.html').read_text()


def test_parquet_holds_the_same(out: Path) -> None:
    parquet = pytest.importorskip('pyarrow.parquet', reason='pip install aerarm_ros[fleet]')
    table = parquet.read_table(out / 'fleet.parquet').to_pylist()
    text = rows(out)
    assert [row['bag'] for row in table] == [row['bag'] for row in text]
    assert table[0]['fs_joint2'] == float(text[0]['fs_joint2'])
    assert table[3]['fs_joint2'] is None


def test_an_interrupted_run_continues(
    out: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = tmp_path / 'again'
    again.mkdir()
    lines = (out / 'rows.jsonl').read_text().splitlines()
    kept = [line for line in lines if json.loads(line)['row']['bag'].endswith('a.npz')]
    (again / 'rows.jsonl').write_text('\n'.join([*kept, lines[0][:40]]) + '\n')
    assert run('--each', folder, '--workers', 1, '--out', again) == 0
    assert 'already contains the results of 2 of 4 bags' in capsys.readouterr().err
    old = {row['bag']: row for row in rows(out)}
    for row in rows(again):
        if row['bag'].endswith('a.npz'):
            assert row == old[row['bag']]  # not even its time is another
    assert comparable(rows(again)) == comparable(rows(out))


def test_other_options_begin_again(out: Path, folder: Path, tmp_path: Path, capsys: Any) -> None:
    again = tmp_path / 'again'
    again.mkdir()
    (again / 'rows.jsonl').write_bytes((out / 'rows.jsonl').read_bytes())
    arguments = ['--each', str(folder / 'left' / 'a.npz'), '--out', str(again), '--workers', '1']
    assert main([*arguments, *OPTIONS[:-2], '--cutoff', '3']) == 0
    assert 'already' not in capsys.readouterr().err
    (row,) = rows(again)
    assert float(row['cutoff']) == 3.0


def test_bags_are_found_in_folders_patterns_and_lists(folder: Path, tmp_path: Path) -> None:
    assert len(find_bags([folder])) == 4
    assert len(find_bags([folder / '*' / 'a.npz'])) == 2
    listed = tmp_path / 'bags.txt'
    listed.write_text(f'# two\n{folder}/left/a.npz\n{folder}/right\n')
    assert len(find_bags([listed, folder / 'left' / 'a.npz'])) == 3
    with pytest.raises(IdentificationError, match='names no bag'):
        find_bags([tmp_path / 'nothing'])


def test_impossible_options_print_one_line(folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert run('--each', folder, '--validation', folder) == 2
    assert 'cannot be combined with --each' in capsys.readouterr().err
    (tmp_path / 'other').write_text('kept')
    assert run('--each', folder, '--out', tmp_path) == 2
    assert 'contains files of another program' in capsys.readouterr().err
    only = folder / 'right' / 'still.npz'
    assert run('--each', only, '--out', tmp_path / 'new', '--workers', 1) == 2
    assert 'none of 1 bags could be identified' in capsys.readouterr().err
