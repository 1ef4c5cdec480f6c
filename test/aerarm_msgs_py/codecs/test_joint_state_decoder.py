import struct

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr, JointStateDecoder

ARMS = [JointStateCdr(names, frame) for names in (['a', 'b'], ['b', 'a'], ['a', 'bb', 'c'])
        for frame in ('', 'base')]  # fmt: skip


@given(st.lists(st.tuples(st.sampled_from(ARMS), st.integers(0, 7)), min_size=1, max_size=30))
def test_a_mixture_is_decoded_message_by_message(kinds) -> None:
    rng = np.random.default_rng(len(kinds))
    payloads, expected = [], []
    for k, (codec, full) in enumerate(kinds):
        values = rng.normal(size=(3, len(codec.names)))
        fields = [x if full >> i & 1 else None for i, x in enumerate(values)]
        payloads.append(codec.pack(k, *fields))
        expected.append((codec.names, fields))
    decoder = JointStateDecoder()
    stamp_ns, values = decoder.decode(Payloads.of(payloads))
    assert stamp_ns.tolist() == list(range(len(kinds)))
    for row, (names, fields) in zip(values, expected, strict=True):
        columns = [decoder.names.index(name) for name in names]
        for found, field in zip(row[:, columns], fields, strict=True):
            np.testing.assert_array_equal(found, np.nan if field is None else field)
        others = [k for k in range(len(decoder.names)) if k not in columns]
        assert np.isnan(row[:, others]).all()


def test_big_endian_messages() -> None:
    body = struct.pack('>iI', 3, 4) + struct.pack('>I4s', 1, b'\0???')
    body += struct.pack('>II2s2x', 1, 2, b'a\0')  # one name
    body += struct.pack('>Id', 1, 1.5) + struct.pack('>I4xd', 1, 2.5) + struct.pack('>I', 0)
    stamp_ns, values = JointStateDecoder().decode(Payloads.of([b'\0\0\0\0' + body] * 2))
    assert stamp_ns.tolist() == [3_000_000_004] * 2
    np.testing.assert_array_equal(values, [[[1.5], [2.5], [np.nan]]] * 2)
