"""Each code block of the page on identifying any arm runs, and gives the shown figures."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.nodes import identifier

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'how-to' / 'identify_any_arm.md'


def blocks(language: str) -> list[str]:
    """Return the code blocks of the page in one language."""
    found = re.findall(r'^```(\w*)\n(.*?)^```$', PAGE.read_text(), re.MULTILINE | re.DOTALL)
    return [text for named, text in found if named == language]


def test_the_page_from_the_log_to_the_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    make_log, use = blocks('python')
    exec(compile(make_log, 'make_log.py', 'exec'), {})
    copy, identify = blocks('sh')[1].strip().splitlines()
    exec(shlex.split(copy)[2], {})
    assert identifier.main(shlex.split(identify)[1:]) == 0
    printed = capsys.readouterr().out
    shown = next(text for text in blocks('') if 'cad_friction' in text)
    for line in shown.strip().splitlines()[3:]:
        name, *figures = re.findall(r'[a-z_]+(?= )|\d+\.\d+', line.split('  not')[0])
        (row,) = re.findall(rf'^{name} .*$', printed, re.MULTILINE)
        assert [float(text) for text in re.findall(r'\d+\.\d+', row)] == pytest.approx(
            [float(text) for text in figures], abs=0.05
        ), name
    names: dict = {}
    exec(compile(use, 'use.py', 'exec'), names)
    assert names['arm'].parameters['fs_shoulder'] == pytest.approx(2.0, abs=0.02)
    assert np.isfinite(names['arm'].torque([0.1] * 6, [0.0] * 6, [0.0] * 6)).all()
