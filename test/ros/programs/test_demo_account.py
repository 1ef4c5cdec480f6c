"""The demo's final summary, read from its nodes' logs."""

from pathlib import Path

import pytest

from aerarm_ros.ros.programs.demo_run import DemoError, account_lines

BRIDGE = 'fake_hardware: 999 cycles, the simulation ran at {} % of real time{}\n'
RECORDER = (
    '[INFO] [1.0] [recorder]: /joint_states: 900 messages, 5 lost\n'
    '[INFO] [1.1] [recorder]: out/bag: 2000 messages, {} lost\n'
)


def account(tmp_path: Path, share: str = '99.9', lost: int | str = 0, slip: str = '') -> list[str]:
    bridge, first, second = (tmp_path / name for name in ('bridge', 'first', 'second'))
    bridge.write_text('[INFO] idle\n' + BRIDGE.format(share, slip))
    first.write_text(RECORDER.format(0))
    second.write_text(RECORDER.format(lost))
    return account_lines(bridge, {'identification': first, 'validation': second})


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        (
            {
                'share': '81.6',
                'slip': ', 11.68 s behind real time: this computer is too slow for a real arm',
            },
            'NOTE      this computer was too slow for real time. The results are valid, because '
            'the simulation waited. For a real arm, ',
        ),
        ({'lost': 7}, 'WARNING   7 messages are missing from the bags: '),
    ],
)
def test_warnings_contain_a_remedy(tmp_path: Path, given: dict, said: str) -> None:
    *_, warning = account(tmp_path, **given)
    assert warning.startswith(said)
    assert 'real-time priority (docs/how-to/raspberry_pi.md, "Real time")' in warning


def test_a_log_without_its_final_line_is_named(tmp_path: Path) -> None:
    (tmp_path / 'bridge').write_text('Killed\n')
    with pytest.raises(DemoError, match='no line of .*bridge matches'):
        account_lines(tmp_path / 'bridge', {})
