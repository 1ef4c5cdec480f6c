"""Messages in a buffer, one by one and as rows."""

import numpy as np
import pytest

from aerarm_msgs_py.codecs.cdr import Payloads, elements_at

MESSAGES = [b'abc', b'', b'defg', b'hij']


def test_messages_come_out_as_they_went_in() -> None:
    payloads = Payloads.of(MESSAGES)
    assert list(payloads) == MESSAGES
    assert payloads[2] == b'defg'
    assert list(payloads[1:3]) == MESSAGES[1:3]
    assert payloads.sizes.tolist() == [3, 0, 4, 3]


def test_messages_of_equal_size_are_rows() -> None:
    rows = Payloads.of(MESSAGES).rows(np.array([3, 0]))
    assert [row.tobytes() for row in rows] == [b'hij', b'abc']
    assert Payloads.of([b'']).rows(np.array([0])).shape == (1, 0)
    assert Payloads.of([]).rows(np.array([], np.intp)).shape == (0, 0)


def test_elements_may_begin_at_any_byte_but_not_beyond_the_end() -> None:
    kind = np.dtype('<u2')
    assert elements_at(b'\1\0\2', kind, np.array([0, 1])).tolist() == [1, 512]
    with pytest.raises(IndexError):
        elements_at(b'\1\0\2', kind, np.array([2]))
    with pytest.raises(IndexError):
        elements_at(b'\1', kind, np.array([0]))
    assert len(elements_at(b'', kind, np.array([], np.int64))) == 0
