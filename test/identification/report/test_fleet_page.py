"""What drifts and which arm differs is found among bags, and nothing else."""

import numpy as np

from aerarm_ros.identification.report.fleet_page import find_drifts, find_odd_arms, fleet_page

_ARMS = [f'arm{number}' for number in range(6)]


def rows() -> list[dict[str, object]]:
    """Return ten bags of each arm: friction of arm2 drifts, arm4 has another rotor."""
    random = np.random.default_rng(3)
    found: list[dict[str, object]] = []
    for arm in _ARMS:
        own = {'fs_joint1': random.normal(0.3, 0.01), 'Ja_joint1': random.normal(0.02, 2e-4)}
        for week in range(10):
            row: dict[str, object] = {
                'bag': f'{arm}/{week}',
                'arm': arm,
                'date': f'2026-{1 + week:02d}-05T10:00:00+00:00',
                'status': 'ok',
                'reason': None,
                'validation_sdp_filtered': 2.0,
            }
            for name, value in own.items():
                drift = 0.012 * week if (arm, name) == ('arm2', 'fs_joint1') else 0.0
                other = 0.01 if (arm, name) == ('arm4', 'Ja_joint1') else 0.0
                std = 0.02 * value
                row[name] = value + drift + other + random.normal(0.0, std)
                row[f'{name}_std'] = std
            found.append(row)
    return found


def test_the_drift_of_one_arm_is_found() -> None:
    (drift,) = find_drifts(rows())
    assert (drift.arm, drift.parameter) == ('arm2', 'fs_joint1')
    assert abs(drift.change - 9 * 0.012) < 0.03


def test_the_arm_that_differs_is_found() -> None:
    odd = find_odd_arms(rows())
    assert ('arm4', 'Ja_joint1') in {(o.arm, o.parameter) for o in odd}
    assert {o.arm for o in odd} <= {'arm4', 'arm2'}


def test_the_page_names_drifts_deviating_arms_and_failed_bags() -> None:
    failed = {'bag': 'x', 'arm': 'arm1', 'date': None, 'status': 'failed', 'reason': 'no <bag>'}
    text = fleet_page([*rows(), failed])
    assert '60 of 61 bags of 6 arms were identified' in text
    assert 'no &lt;bag&gt;' in text
    assert text.count('Plotly.newPlot(') == 3  # errors, and the two parameters of joints


def test_tables_without_dates_have_a_page_too() -> None:
    undated = [row | {'date': None} for row in rows()]
    assert find_drifts(undated) == []
    assert 'Plotly.newPlot(' in fleet_page(undated)
