"""Reader of ROS 1 and SQLite bag files, which uses the library rosbags in a separate process.

rosbags does not check the sizes that a file declares. The separate process therefore has limits of
memory and processor time, in proportion to the size of the file. If the process reaches a limit,
reading ends with one error.
"""

import json
import marshal
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage import foreign_reader
from aerarm_msgs_py.storage.compressed_file import BagFile
from aerarm_msgs_py.storage.foreign_reader import SIZE
from aerarm_msgs_py.storage.mcap_records import MOST_TOPICS
from aerarm_msgs_py.storage.read_limits import BagError, MessageBlock, reading

_BEGINNINGS = {
    '.bag': (b'#ROSBAG V2.0\n', 'a ROS 1 bag (format version 2.0)'),
    '.db3': (b'SQLite format 3\0', 'an SQLite file'),
}
_REPAIRS = {'.bag': 'rosbag reindex', '.db3': 'sqlite3 FILE .recover'}

# Limits of the process in addition to its start. Per MB a valid file needs 0.1 s and 1 MB. With
# empty messages it needs ten times this memory, because rosbags keeps the index of a ROS 1 file.
_SECONDS, _SECONDS_PER_BYTE = 2.0, 2e-6
_MEMORY, _MEMORY_PER_BYTE = 100 * 2**20, 10.0
_MOST_SECONDS, _MOST_MEMORY = 2**31, 2**62


class ForeignFile(BagFile):
    """Reader of one .bag or .db3 file.

    The messages are in order of reception. ROS 1 messages of standard types are converted to ROS 2.
    Only data compressed by bz2 has checksums; other damage inside a message is not detected.

    `counts` is from the index or the tables of the file.
    """

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of `topics` in blocks; None selects all topics.

        Raises
        ------
        BagError
            If rosbags cannot open the file, or reading it exceeds the limits of memory or time.
        """
        size = self._checked_size()
        process = self._started(size, topics)
        count = 0
        end: dict[str, Any] = {}
        try:
            for block in self._received(process, end):
                self._budget.spend(sum(block.payloads.sizes.tolist()))
                count += len(block.payloads)
                yield block
        finally:
            process.kill()
            process.communicate()
        if error := end['error']:
            if not count:
                repair = _REPAIRS[self.path.suffix]
                raise BagError(
                    f'the file {self.path} cannot be read: {error}; copy it again, or '
                    f'repair it ({repair})'
                )
            self._report.add(
                f'the file is damaged ({error}): only the {count} messages before the damage are '
                'read'
            )
        if missing := end['missing']:
            self._report.add(
                f'the reader ignores {missing} messages with values of a wrong type, or without '
                'topic or time'
            )
        self._report.finish()

    def _checked_size(self) -> int:
        beginning, kind = _BEGINNINGS[self.path.suffix]
        with reading(self.path), self.path.open('rb') as stream:
            size = self.path.stat().st_size
            found = stream.read(len(beginning))
        if not size:
            raise BagError(f'the file {self.path} is empty: record or copy it again')
        if found != beginning:
            raise BagError(f'the file {self.path} is not {kind}: check the path')
        return size

    def _started(self, size: int, topics: Collection[str] | None) -> 'subprocess.Popen[bytes]':
        budget = self._budget
        arguments = {
            'path': str(self.path),
            'topics': None if topics is None else list(topics),
            'part_bytes': budget.part_bytes,
            'most_topics': MOST_TOPICS,
            'seconds': min(_MOST_SECONDS, _SECONDS + _SECONDS_PER_BYTE * size * budget.scale),
            'memory': min(_MOST_MEMORY, _MEMORY + _MEMORY_PER_BYTE * size * budget.scale),
        }
        return subprocess.Popen(
            [sys.executable, '-S', '-P', foreign_reader.__file__, json.dumps(arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        )

    def _received(
        self, process: 'subprocess.Popen[bytes]', end: dict[str, Any]
    ) -> Iterator[MessageBlock]:
        """Yield the blocks that the reading process writes; store its final report in `end`."""
        stream = process.stdout
        assert stream
        while len(head := stream.read(SIZE.size)) == SIZE.size:
            (size,) = SIZE.unpack(head)
            content = stream.read(size)
            if len(content) < size:
                break
            kind, *item = marshal.loads(content)
            if kind == 'topics':
                self.types = {name: kind for name, kind, _ in item[0]}
                self.counts = {name: messages for name, _, messages in item[0]}
            elif kind == 'messages':
                topic, times, payloads = item
                yield MessageBlock(
                    topic,
                    self.types[topic],
                    np.array(times, np.int64),
                    np.zeros(len(times), np.int64),
                    Payloads.of(payloads),
                )
            else:
                end.update(item[0])
        if not end:
            end['limit'] = 'time' if process.wait() == -signal.SIGXCPU else 'memory'
        if end['limit']:
            raise BagError(
                f'reading the file {self.path} takes more {end["limit"]} than the limit for its '
                'size. The file may be damaged or malicious; if you trust it, raise the limit '
                "'ratio'"
            )
