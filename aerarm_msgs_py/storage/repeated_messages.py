"""Messages that a damaged bag holds twice."""

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.payloads import Payloads

Keys = NDArray[np.uint64]

# Odd, so that multiplication by them loses nothing; any will do.
_MIX_TIME, _MIX_SEQUENCE = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F)
_WORD = 8


class RepeatedMessages:
    """Finds messages of one topic that came before: same reception, number and bytes.

    Eight bytes of each message are remembered. They are looked through only where time of
    reception doesn't rise, as it does in every bag that is whole.
    """

    def __init__(self) -> None:
        self._newest = -(2**63)
        self._known: Keys = np.empty(0, np.uint64)
        self._recent: list[Keys] = []

    def first_ones(
        self, log_time: NDArray[np.int64], sequence: NDArray[np.int64], payloads: Payloads
    ) -> NDArray[np.bool_] | None:
        """Return which of (K,) messages did not come before; None for all of them."""
        if not len(log_time):
            return None
        keys = _keys(log_time, sequence, payloads)
        later = bool(log_time.min() > self._newest)
        self._newest = max(self._newest, int(log_time.max()))
        first = None
        if not (later and bool((np.diff(log_time) > 0).all())):
            first = self._first(keys, later)
        self._recent.append(keys if first is None else keys[first])
        return first

    def _first(self, keys: Keys, later: bool) -> NDArray[np.bool_] | None:
        first = np.zeros(len(keys), bool)
        first[np.unique(keys, return_index=True)[1]] = True
        if not later:
            # Sorted anew every time, which is quick where most of it was sorted before.
            self._known = np.sort(np.concatenate([self._known, *self._recent]), kind='stable')
            self._recent.clear()
            place = np.searchsorted(self._known, keys)
            first &= np.append(self._known, 0)[place] != keys
        return None if first.all() else first


def _keys(log_time: NDArray[np.int64], sequence: NDArray[np.int64], payloads: Payloads) -> Keys:
    """Return a number for each message that another one has by a chance of 1 in 2^64."""
    keys = log_time.astype(np.uint64) * _MIX_TIME ^ sequence.astype(np.uint64) * _MIX_SEQUENCE
    sizes = payloads.sizes
    order = np.argsort(sizes, kind='stable')
    ends = np.flatnonzero(np.diff(sizes[order], append=-1)) + 1
    for index in np.split(order, ends[:-1]):
        rows = payloads.rows(index)
        words = np.zeros((len(rows), -(-rows.shape[1] // _WORD) * _WORD), np.uint8)
        words[:, : rows.shape[1]] = rows
        numbers = words.view(np.uint64)
        weights = np.random.default_rng(numbers.shape[1]).integers(
            0, 2**64, numbers.shape[1], np.uint64
        )
        keys[index] ^= ((numbers ^ (numbers >> np.uint64(29))) * (weights | np.uint64(1))).sum(1)
    return keys
