"""Joint states of a bag, collected block by block."""

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.bags.joint_state_series import JointStateSeries
from aerarm_msgs_py.codecs.joint_state_decoder import JointStateDecoder
from aerarm_msgs_py.codecs.payloads import Payloads
from aerarm_msgs_py.storage.message_block import MessageBlock
from aerarm_msgs_py.storage.read_limits import ReadBudget

_GROWTH = 1.125  # small: numpy fills with zeros, so unused room takes memory too
_FIRST = 4096  # messages
_SINGLE_BYTES = 3000  # counted for a message that is decoded by itself, as that takes time


class JointStateBuilder:
    """Arrays that grow with every block.

    They grow in place, which the system does without copying where they are large: at no
    time are the messages in memory twice.

    Parameters
    ----------
    most
        Messages to keep; those beyond are left out and counted.
    thinned
        Keep no more than twice as many messages, evenly spread over the bag: enough for a
        picture of a topic.
    budget
        What the arrays, and the time to fill them, are taken from.

    Attributes
    ----------
    left_out
        Messages beyond `most`.
    irregular
        Fields left out because their length was neither 0 nor that of the names.
    """

    def __init__(
        self,
        most: int | None = None,
        thinned: int | None = None,
        budget: ReadBudget | None = None,
    ) -> None:
        self.left_out = 0
        self._most = most
        self._thinned = thinned
        self._stride, self._seen = 1, 0  # of the messages kept; messages that came
        self._decoder = JointStateDecoder()
        self._budget = budget
        self._count = 0
        self._times = np.empty((0, 2), np.int64)  # stamp, reception [ns]
        self._sequence = np.empty(0, np.int64)
        self._values = np.empty((0, 3, 0))

    def __len__(self) -> int:
        return self._count

    @property
    def irregular(self) -> int:
        """See the class."""
        return self._decoder.irregular

    def add(self, block: MessageBlock) -> None:
        """Decode and append messages.

        Raises
        ------
        ValueError
            If one is no JointState.
        BagError
            If the budget is spent.
        """
        if self._thinned is not None:
            self._thin_out(2 * self._thinned)
        payloads, log_time, sequence = self._kept(block)
        if self._most is not None and self._count + len(payloads) > self._most:
            self.left_out += len(payloads) - (self._most - self._count)
            payloads = payloads[: self._most - self._count]
        if not len(payloads):
            return
        singly = self._decoder.singly
        stamp_ns, values = self._decoder.decode(payloads)
        if self._budget:
            self._budget.spend(values.nbytes + _SINGLE_BYTES * (self._decoder.singly - singly))
        first, last = self._count, self._count + len(stamp_ns)
        self._reserve(last, values.shape[2])
        self._times[first:last, 0] = stamp_ns
        self._times[first:last, 1] = log_time[: last - first]
        self._sequence[first:last] = sequence[: last - first]
        self._values[first:last] = values
        self._count = last

    def series(self) -> JointStateSeries:
        """Return everything collected, in order of reception, and collect no more."""
        for array in (self._times, self._sequence, self._values):
            array.resize((self._count, *array.shape[1:]), refcheck=False)
        self._sort()
        return JointStateSeries(
            names=tuple(self._decoder.names),
            stamp=self._times[:, 0] / 1e9,
            log_time=self._times[:, 1] / 1e9,
            position=self._values[:, 0],
            velocity=self._values[:, 1],
            effort=self._values[:, 2],
            sequence=self._sequence,
        )

    def _sort(self) -> None:
        """Put messages in order of reception, if a file has them otherwise."""
        log_time = self._times[:, 1]
        if (np.diff(log_time) < 0).any():
            order = np.argsort(log_time, kind='stable')
            self._times, self._sequence = self._times[order], self._sequence[order]
            self._values = self._values[order]

    def _kept(self, block: MessageBlock) -> tuple[Payloads, NDArray[np.int64], NDArray[np.int64]]:
        """Return every so many messages of a block, with reception and sequence number."""
        part = slice(-self._seen % self._stride, None, self._stride)
        self._seen += len(block.payloads)
        if self._stride == 1:
            return block.payloads, block.log_time, block.sequence
        return block.payloads[part], block.log_time[part], block.sequence[part]

    def _thin_out(self, limit: int) -> None:
        """Leave out every second message, also of those to come, once there are too many."""
        if self._count < limit:
            return
        before, self._count = self._count, (self._count + 1) // 2
        for array in (self._times, self._sequence, self._values):
            array[: self._count] = array[:before:2].copy()
        self._stride *= 2

    def _reserve(self, count: int, joints: int) -> None:
        known = self._values.shape[2]
        if joints > known:  # rare: a joint that was not in the messages before
            wider: NDArray[np.float64] = np.full((len(self._values), 3, joints), np.nan)
            wider[:, :, :known] = self._values
            self._values = wider
        if count > len(self._values):
            capacity = max(count, _FIRST, int(_GROWTH * len(self._values)))
            for array in (self._times, self._sequence, self._values):
                array.resize((capacity, *array.shape[1:]), refcheck=False)
