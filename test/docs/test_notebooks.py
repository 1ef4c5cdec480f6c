"""Every notebook runs completely, and shows the described results."""

import ast
import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).resolve().parents[2] / 'docs' / 'notebooks'


def run(name: str, monkeypatch: pytest.MonkeyPatch, folder: Path) -> tuple[dict[str, Any], list]:
    """Run the cells of a notebook; return its names, and the last values of its cells."""
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    shown = []
    for cell in json.loads((FOLDER / name).read_text())['cells']:
        if cell['cell_type'] != 'code':
            continue
        tree = ast.parse(''.join(cell['source']))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, name, 'exec'), names)
        if last is not None:
            assert cell['outputs'], 'a notebook is stored as it was run: run it'
            assert not any(output['output_type'] == 'error' for output in cell['outputs'])
            shown.append(eval(compile(ast.Expression(last.value), name, 'eval'), names))
    return names, shown


def test_all_of_them_are_run() -> None:
    assert sorted(file.name for file in FOLDER.iterdir()) == [
        *('identify.ipynb', 'own_arm.ipynb', 'plan.ipynb')
    ]


def test_from_a_motion_to_a_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    names, shown = run('identify.ipynb', monkeypatch, tmp_path)
    arm = names['arm']
    assert shown[0] is arm
    assert '<table>' in arm._repr_html_()
    assert arm.errors[0].filtered < 2.0
    for joint, true in zip(names['robot'].joint_names, names['coulomb'], strict=True):
        assert arm.parameters[f'fs_{joint}'] == pytest.approx(true, rel=0.05)
    found, true = shown[-2]
    assert found == pytest.approx(true, abs=0.1)
    assert {'estimate.yaml', 'identified.sdf', 'report.html'} <= set(shown[-1])


def test_a_motion_worth_recording(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    names, shown = run('plan.ipynb', monkeypatch, tmp_path)
    assert shown[0] is names['plan']
    assert 'condition number' in names['plan']._repr_html_()
    assert 'fundamental_frequency' in ' '.join(shown[-1])


def test_an_own_arm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    names, shown = run('own_arm.ipynb', monkeypatch, tmp_path)
    assert names['arm'].errors[0].filtered < 5.0
    _, _, hints, torques, friction = shown
    assert '--effort-gain shoulder' in ' '.join(hints)
    assert torques[0] == pytest.approx(torques[1])
    assert friction[0] == pytest.approx(friction[1], rel=0.05)
