"""CRC-32/MPEG-2, the check of the boards' frames."""

import zlib

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
