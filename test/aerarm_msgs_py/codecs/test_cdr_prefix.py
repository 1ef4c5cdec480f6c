import numpy as np

from aerarm_msgs_py.codecs.cdr import CdrPrefix


def prefix_of(*texts: str) -> CdrPrefix:
    return CdrPrefix(4, '', texts)


def test_padding_is_open_and_everything_else_is_not() -> None:
    prefix = prefix_of('a', 'b')
    payload = bytearray(b'\0\1\0\0' + prefix.content)
    padding = {9, 10, 11, 22, 23, 30, 31}  # behind '\0', 'a\0' and 'b\0'
    for k in range(4, len(payload)):
        changed = payload.copy()
        changed[k] ^= 0x55
        assert prefix.matches(bytes(changed)) == (k in padding)
        rows = np.frombuffer(bytes(payload + changed), np.uint8).reshape(2, -1)
        assert prefix.matching_rows(rows).tolist() == [True, k in padding]


def test_a_short_payload_does_not_match() -> None:
    prefix = prefix_of('joint')
    payload = b'\0\1\0\0' + prefix.content
    assert prefix.matches(payload)
    assert not prefix.matches(payload[:-1])
