"""CRC-32/MPEG-2, the check of the boards' frames."""

import zlib

import numpy as np
from numpy.typing import NDArray

_POLYNOMIAL = 0x04C11DB7
_MASK = 0xFFFFFFFF
_BIT_REVERSED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC-32/MPEG-2 of some bytes: polynomial 0x04C11DB7, start value all ones.

    The CRC-32 of zlib divides by the same polynomial from the same start value, but takes
    the bits of each byte from the other end and inverts the result. Reversing the bits
    before and after it therefore gives this CRC at the speed of compiled code.

    Parameters
    ----------
    data
        Any number of bytes, first byte first.

    Returns
    -------
    int
        The check value, 0 <= crc < 2**32.
    """
    reflected = zlib.crc32(data.translate(_BIT_REVERSED)) ^ _MASK
    return int.from_bytes(reflected.to_bytes(4, 'little').translate(_BIT_REVERSED), 'big')


def crc32_mpeg2_rows(rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return the CRC-32/MPEG-2 of every row of a table of bytes.

    It shares no code with `crc32_mpeg2` and walks a table of 256 remainders, so that each
    is a check of the other; use it for many frames of one length.

    Parameters
    ----------
    rows
        Bytes (M, k).

    Returns
    -------
    numpy.ndarray
        Check values (M,).
    """
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
