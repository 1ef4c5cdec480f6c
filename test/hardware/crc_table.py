"""CRC-32/MPEG-2 by a table of remainders, as an independent check of the one by zlib."""

import numpy as np
from numpy.typing import NDArray

_POLYNOMIAL = 0x04C11DB7
_MASK = 0xFFFFFFFF


def crc32_mpeg2_rows(rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return the check values (M,) of the rows of a table of bytes (M, k)."""
    remainder = np.full(len(rows), _MASK, dtype=np.uint32)
    for column in rows.T:
        remainder = (remainder << np.uint32(8)) ^ _REMAINDERS[(remainder >> np.uint32(24)) ^ column]
    return remainder


def _remainder_table() -> NDArray[np.uint32]:
    """Return the remainder (256,) left by each leading byte."""
    table = np.arange(256, dtype=np.uint32) << np.uint32(24)
    for _ in range(8):
        carry = (table >> np.uint32(31)).astype(bool)
        table = (table << np.uint32(1)) ^ np.where(carry, np.uint32(_POLYNOMIAL), np.uint32(0))
    return table


_REMAINDERS = _remainder_table()
