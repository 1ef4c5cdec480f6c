"""Many serialized JointStates to arrays, vectorised where their layouts agree."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr_reader import CdrReader
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.codecs.payloads import Payloads

_KNOWN_LAYOUTS = 8


class JointStateDecoder:
    """Decodes blocks of payloads, and remembers joint names from block to block.

    Messages of equal names, frame and size are decoded together by `JointStateCdr`; any
    other one by itself. Columns are joints by name: a joint met for the first time gets a
    new column.

    Attributes
    ----------
    names
        Joint names met so far, in the order of the columns.
    irregular
        Fields left out because their length was neither 0 nor that of the names.
    """

    def __init__(self) -> None:
        self.names: list[str] = []
        self.irregular = 0
        self._codecs: list[tuple[JointStateCdr, list[int]]] = []

    def decode(self, payloads: Payloads) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Decode K messages.

        Returns
        -------
        stamp_ns : (K,) `header.stamp` [ns]
        values : (K, 3, n) position, velocity, effort [rad, rad/s, Nm] of all joints met so
            far; NaN where missing

        Raises
        ------
        ValueError
            If a payload is no JointState, or names a joint twice.
        """
        stamp_ns = np.zeros(len(payloads), np.int64)
        values = np.full((len(payloads), 3, len(self.names)), np.nan)
        sizes = payloads.sizes
        for size in dict.fromkeys(sizes.tolist()):
            values = self._decode_group(payloads, np.flatnonzero(sizes == size), stamp_ns, values)
        return stamp_ns, values

    def _decode_group(
        self,
        payloads: Payloads,
        index: NDArray[np.intp],
        stamp_ns: NDArray[np.int64],
        values: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Decode messages of equal size into their rows; return values, wider if needed."""
        rows = payloads.rows(index)
        if self._decode_rows(rows, index, stamp_ns, values):
            return values
        codecs = len(self._codecs)
        for done, k in enumerate(index.tolist()):
            stamp_ns[k], numbers, columns = self._decode_one(payloads[k])
            values = self._widened(values)
            values[k][:, columns] = numbers
            # The first message shows the layout that the others usually have.
            first = done == 0 and len(self._codecs) > codecs
            if first and self._decode_rows(rows, index, stamp_ns, values):
                break
        return values

    def _decode_rows(
        self,
        rows: NDArray[np.uint8],
        index: NDArray[np.intp],
        stamp_ns: NDArray[np.int64],
        values: NDArray[np.float64],
    ) -> bool:
        """Decode messages of one layout met before; return whether they were."""
        for codec, columns in self._codecs:
            block = codec.unpack_block(rows)
            if block is not None:
                stamp_ns[index] = block[0]
                values[index[:, None], :, columns] = block[1].transpose(0, 2, 1)
                return True
        return False

    def _decode_one(self, payload: bytes) -> tuple[int, NDArray[np.float64], list[int]]:
        """Return stamp [ns], (3, m) numbers and the m columns they belong to."""
        reader = CdrReader(payload)
        stamp_ns = reader.int32() * 1_000_000_000 + reader.uint32()
        frame_id = reader.string()
        names = reader.strings()
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise ValueError(
                f'a message names joint {", ".join(repeated)} more than once: check the joint '
                'names of the node that publishes it'
            )
        fields = [reader.doubles() for _ in range(3)]
        numbers = np.full((3, len(names)), np.nan)
        for row, field in zip(numbers, fields, strict=True):
            if len(field) == len(names):
                row[:] = field
            else:
                self.irregular += len(field) > 0
        for name in names:
            if name not in self.names:
                self.names.append(name)
        columns = [self.names.index(name) for name in names]
        self._remember(names, frame_id, columns)
        return stamp_ns, numbers, columns

    def _remember(self, names: list[str], frame_id: str, columns: list[int]) -> None:
        known = any(
            codec.names == tuple(names) and codec.frame_id == frame_id for codec, _ in self._codecs
        )
        if not known and names:
            self._codecs.append((JointStateCdr(names, frame_id), columns))
            del self._codecs[:-_KNOWN_LAYOUTS]

    def _widened(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        missing = len(self.names) - values.shape[2]
        if not missing:
            return values
        return np.concatenate([values, np.full((*values.shape[:2], missing), np.nan)], axis=2)
