"""Decimated joint states: the newest sample of each window with minimum and maximum.

A plot of 50 samples per second shows a peak of 1 ms only if each window contains its extremes. The
newest sample is sent in single precision. The distances to the extremes are sent in half precision,
rounded away from the newest sample. A window takes 8 bytes, plus 8 per number. That is a tenth of
the serialized joint state message.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_HEAD = struct.Struct('<qHH')  # stamp, samples, numbers


class Window(NamedTuple):
    """The samples of a stream since the last window.

    Attributes
    ----------
    stamp_ns
        Stamp of the newest sample [ns].
    samples
        Number of samples.
    newest, minimum, maximum : (n,) ndarray
        `minimum` and `maximum` are NaN where a sample of the window is NaN.
    """

    stamp_ns: int
    samples: int
    newest: NDArray[np.float64]
    minimum: NDArray[np.float64]
    maximum: NDArray[np.float64]


def window_of(stamp_ns: int, samples: Sequence[NDArray[np.float64]]) -> Window:
    """Return the window of samples, (n,) each; the stamp belongs to the last one."""
    rows = np.stack(samples)
    return Window(
        stamp_ns,
        len(rows),
        rows[-1],
        rows.min(axis=0),
        rows.max(axis=0),
    )


def pack_window(window: Window) -> bytes:
    """Return a window as bytes."""
    newest = window.newest.astype('<f4')
    with np.errstate(over='ignore', invalid='ignore'):
        below = _rounded_up(newest - window.minimum)
        above = _rounded_up(window.maximum - newest)
    head = _HEAD.pack(window.stamp_ns, min(window.samples, 65535), len(newest))
    return head + newest.tobytes() + below.tobytes() + above.tobytes()


def unpack_window(content: bytes) -> Window:
    """Return the window of bytes; raises ValueError if they are invalid."""
    if len(content) < _HEAD.size:
        raise ValueError('a window of messages is truncated')
    stamp_ns, count, n = _HEAD.unpack_from(content)
    if len(content) != _HEAD.size + 8 * n:
        raise ValueError(f'a window of {n} numbers has {len(content)} bytes')
    place = _HEAD.size
    newest = np.frombuffer(content, '<f4', n, place).astype(float)
    below, above = np.frombuffer(content, '<f2', 2 * n, place + 4 * n).astype(float).reshape(2, n)
    return Window(stamp_ns, count, newest, newest - below, newest + above)


def _rounded_up(distance: NDArray[np.float64]) -> NDArray[np.float16]:
    """Round distances, 0 or more, up to half precision."""
    half = np.maximum(distance, 0.0).astype('<f2')
    low = half < distance
    half[low] = np.nextafter(half[low], np.float16(np.inf))
    return half
