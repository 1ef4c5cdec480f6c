"""What the demo says at its end, read from its nodes' logs."""

from pathlib import Path

import pytest

from aerarm_ros.nodes.demo_account import DemoAccount

BRIDGE = 'fake_hardware: {} cycles, {} missed ({} %), woken 34 us late (median), 131 us (99.9 %)\n'
RECORDER = (
    '[INFO] [1.0] [recorder]: /joint_states: 900 messages, 5 lost\n'
    '[INFO] [1.1] [recorder]: out/bag: 2000 messages, {} lost\n'
)


def account(tmp_path: Path, share: str = '0.100', lost: int | str = 0) -> DemoAccount:
    bridge, first, second = (tmp_path / name for name in ('bridge', 'first', 'second'))
    bridge.write_text('[INFO] idle\n' + BRIDGE.format(999, 1, share))
    first.write_text(RECORDER.format(0))
    second.write_text(RECORDER.format(lost))
    return DemoAccount.read(bridge, {'identification': first, 'validation': second})


def test_says_what_was_missed_and_lost(tmp_path: Path) -> None:
    assert list(account(tmp_path).lines()) == [
        'Bridge    999 cycles, 1 missed (0.100 %), woken 34 us late (median), 131 us (99.9 %)',
        'Recorder  identification: 2000 messages, 0 lost',
        'Recorder  validation: 2000 messages, 0 lost',
    ]


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'share': '0.101'}, '0.101 % of the cycles were missed, more than 0.1 %: '),
        ({'lost': 7}, 'the bags lack 7 messages: '),
    ],
)
def test_warns_with_what_to_do(tmp_path: Path, given: dict, said: str) -> None:
    *_, warning = account(tmp_path, **given).lines()
    assert warning.startswith(f'WARNING   {said}')
    assert 'real-time priority (docs/how-to/raspberry_pi.md, "Real time")' in warning


def test_messages_without_numbers_are_not_called_complete(tmp_path: Path) -> None:
    *_, last = account(tmp_path, lost='unknown').lines()
    assert last == 'Recorder  validation: 2000 messages, unknown lost'


def test_a_log_without_an_account_is_named(tmp_path: Path) -> None:
    (tmp_path / 'bridge').write_text('Killed\n')
    with pytest.raises(ValueError, match='bridge ends without'):
        DemoAccount.read(tmp_path / 'bridge', {})
