"""Stamps: small disorder is repaired, faults are refused with advice."""

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.signal_checks import check_stamp_unit, usable_messages

STAMP = 100.0 + 1e-3 * np.arange(5000)


def test_jitter_is_fine() -> None:
    jittered = STAMP + 2e-4 * np.random.default_rng(0).uniform(-1, 1, len(STAMP))
    kept, warnings = usable_messages('bag', jittered)
    assert np.array_equal(kept, np.arange(len(STAMP)))
    assert not warnings


def test_a_single_repeated_message_is_left_out() -> None:
    stamp = STAMP.copy()
    stamp[700] = stamp[699]
    kept, warnings = usable_messages('bag', stamp)
    assert len(kept) == len(stamp) - 1
    assert np.all(np.diff(stamp[kept]) > 0.0)
    assert 'repeated' in warnings[0]


def test_two_swapped_messages_are_put_in_order() -> None:
    stamp = STAMP.copy()
    stamp[[50, 51]] = stamp[[51, 50]]
    kept, warnings = usable_messages('bag', stamp)
    assert np.all(np.diff(stamp[kept]) > 0.0)
    assert 'order' in warnings[0]


def test_a_few_lost_messages_are_fine() -> None:
    kept, warnings = usable_messages('bag', np.delete(STAMP, [100, 101, 102, 2000]))
    assert len(kept) == len(STAMP) - 4
    assert not warnings


def broken(kind: str) -> np.ndarray:
    stamp = STAMP.copy()
    if kind == 'constant':
        stamp[:] = 3.0
    elif kind == 'repeated':
        stamp[1000:1200] = stamp[1000]
    elif kind == 'backwards':
        stamp[2500:] -= 1.0
    elif kind == 'jump':
        stamp[2500:] += 5.0
    else:
        stamp[10] = np.nan
    return stamp


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        ('constant', 'same stamp'),
        ('repeated', '199 of 5000 stamps of bag repeat an earlier'),
        ('backwards', 'repeat an earlier|jump back'),
        ('jump', r'bag has no joint states for 5.001 s at 2.50 s of the bag, because the recorder'),
        ('nan', 'not finite'),
    ],
)
def test_faults_are_refused_with_advice(kind: str, text: str) -> None:
    with pytest.raises(IdentificationError, match=text) as caught:
        usable_messages('bag', broken(kind))
    assert 'record again' in str(caught.value)


def test_a_gap_is_placed_in_the_bag_and_in_the_used_part() -> None:
    with pytest.raises(IdentificationError, match=r'at 12.50 s of the bag \(2.50 s of the used'):
        usable_messages('bag', broken('jump'), begin=90.0)


def test_a_clock_set_back_by_less_than_a_gap_is_refused() -> None:
    stamp = 1e-3 * np.arange(20_000)
    stamp[9_000:] -= 0.0504
    with pytest.raises(IdentificationError, match='jump back'):
        usable_messages('bag', stamp)


def test_two_swapped_messages_are_put_in_their_place() -> None:
    stamp = 1e-3 * np.arange(20_000)
    stamp[[9_000, 9_001]] = stamp[[9_001, 9_000]]
    order, warnings = usable_messages('bag', stamp)
    assert np.all(np.diff(stamp[order]) > 0)
    assert len(warnings) == 1


def test_stamps_that_are_no_seconds() -> None:
    check_stamp_unit('bag', STAMP)
    check_stamp_unit('bag', np.full(5, 3.0))
    for factor, unit in ((1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds')):
        with pytest.raises(IdentificationError, match=f's apart, so their stamps look like {unit}'):
            check_stamp_unit('bag', factor * 5.0 * STAMP)
