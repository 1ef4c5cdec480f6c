"""Each mutant of a bag yields all data, part of the data with a count, or one error.

`make fuzz` runs the full number; its counts are in docs/benchmarks_safety.md.
"""

import json
import subprocess
import sys
from pathlib import Path

CAMPAIGN = Path(__file__).with_name('campaign.py')
COUNT = 100  # a defect that 3 % of the mutants show is found with 95 %


def test_no_mutant_of_a_bag_does_harm(tmp_path: Path) -> None:
    file = tmp_path / 'result.json'
    # In a process of its own: every mutant is read by a child of it, which must be small.
    command = [sys.executable, CAMPAIGN, '--count', COUNT, '--seed', 2, '--json', file]
    run = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    found = json.loads(file.read_text())
    assert found['failures'] == []
    outcomes = [counts for counts in found['counts'].values() if counts]
    assert sum(sum(counts.values()) for counts in outcomes) == COUNT
    # A judge that finds nothing to judge would be content too.
    for outcome in ('right', 'part', 'refused'):
        assert sum(counts.get(outcome, 0) for counts in outcomes) > COUNT // 20
