"""Messages of one SQLite file as rosbag2 writes it."""

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage.mcap_records import MOST_TOPICS
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, MessageBlock, ReadBudget

_BLOCK = 1000  # messages
_BLOCK_BYTES = 2**20
_TABLES = ('messages', 'topics')
_DEFINITION_BYTES = 2**20  # of one table's or topic's record
_STEPS = 1000  # of SQLite's machine between two looks at their number
_STEPS_A_BYTE = 10  # a sound file takes less than one
_FREE_STEPS = 10_000_000
_LARGEST = 2**63 - 1  # [ns]


class SqliteFile:
    """Reader of one .db3 file; same use as `McapFile`.

    The format has no checksums: damage inside a message can't be seen.

    Parameters
    ----------
    path
        The .db3 file.
    budget
        What reading may take; by default what the file's own size allows.

    Attributes
    ----------
    types
        Message type of every topic.
    damaged
        Whether reading met damage.
    counts
        Always None: metadata.yaml has the counts.
    """

    def __init__(self, path: Path, budget: ReadBudget | None = None) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self.counts: dict[str, int] | None = None
        self._budget = budget
        self._report = DamageReport(path)

    @property
    def damaged(self) -> bool:
        """See the class."""
        return self._report.places > 0

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all) in the order of recording.

        Raises
        ------
        BagError
            If the file can't be opened or isn't rosbag2's, or would take more memory or time
            than the limits allow.
        """
        try:
            size = self.path.stat().st_size
            self._check(size)
            budget = self._budget or ReadBudget(self.path, size)
            connection = self._connect(size)
        except (OSError, sqlite3.Error) as error:
            raise BagError(f'{self.path} cannot be read: {_said(error)}') from error
        try:
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _DEFINITION_BYTES)
            names = self._read_topics(connection, budget)
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, budget.part_bytes)
            yield from self._messages(connection, names, topics, budget)
        finally:
            connection.close()
        self._report.finish()

    def _check(self, size: int) -> None:
        if not size:
            raise BagError(f'{self.path} is empty: record or copy it again')
        with self.path.open('rb') as stream:
            if not stream.read(16).startswith(b'SQLite format 3\0'):
                raise BagError(f'{self.path} is not an SQLite file: check the path')

    def _connect(self, size: int) -> sqlite3.Connection:
        """Open the file for nothing but reading, and let nothing in it run or grow."""
        path = self.path.resolve().as_uri()
        connection = sqlite3.connect(f'{path}?immutable=1&mode=ro', uri=True)
        connection.text_factory = lambda text: text.decode(errors='replace')
        steps = 0

        def too_long() -> bool:
            nonlocal steps
            steps += _STEPS
            return steps > _FREE_STEPS + _STEPS_A_BYTE * size

        connection.set_progress_handler(too_long, _STEPS)
        connection.execute('PRAGMA trusted_schema = OFF')
        connection.execute('PRAGMA cell_size_check = ON')
        return connection

    def _read_topics(self, connection: sqlite3.Connection, budget: ReadBudget) -> dict[int, str]:
        """Return the topic of each number in the file."""
        names: dict[int, str] = {}
        try:
            self._check_tables(connection)
            for row in connection.execute('SELECT id, name, type FROM topics NOT INDEXED'):
                budget.spend(_size(row))
                number, name, kind = row
                if isinstance(number, int) and isinstance(name, str) and isinstance(kind, str):
                    names[number] = name
                    self.types[name] = kind
                else:
                    self._report.tell('is damaged: the record of a topic is left out')
                if len(names) > MOST_TOPICS:
                    raise BagError(f'the bag has more than {MOST_TOPICS} topics: is it damaged?')
        except (sqlite3.Error, TypeError) as error:
            raise BagError(f'{self.path} cannot be read: {_said(error)}') from error
        return names

    def _check_tables(self, connection: sqlite3.Connection) -> None:
        """Require the tables of a bag, which hold what they say and compute nothing."""
        for table in _TABLES:
            # A view or a virtual table could be endless.
            found = connection.execute(
                "SELECT 1 FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND name = ?",
                (table,),
            )
            if found.fetchone() is None:
                raise BagError(f'{self.path} has no table {table}: is it a bag of rosbag2?')
            columns = connection.execute(f'PRAGMA table_xinfo({table})').fetchall()
            if any(column[-1] for column in columns):  # hidden: generated, of any size
                raise BagError(
                    f'{self.path} computes columns of its table {table}, no bag does: is it made '
                    'to fill the memory?'
                )

    def _messages(
        self,
        connection: sqlite3.Connection,
        names: dict[int, str],
        topics: Collection[str] | None,
        budget: ReadBudget,
    ) -> Iterator[MessageBlock]:
        waiting: dict[str, list[tuple[int, bytes]]] = {}
        held = unknown = 0
        for row in self._rows(connection):
            # Whatever becomes of it: pages of the file may be used by many rows.
            budget.spend(_size(row))
            number, log_time, payload = row
            if not _is_message(number, log_time, payload) or number not in names:
                unknown += 1
                continue
            topic = names[number]
            if topics is not None and topic not in topics:
                continue
            messages = waiting.setdefault(topic, [])
            messages.append((log_time, payload))
            held += len(payload)
            if len(messages) == _BLOCK or held > _BLOCK_BYTES:
                yield self._block(topic, messages)
                held -= sum(len(payload) for _, payload in messages)
                messages.clear()
        for topic, messages in waiting.items():
            if messages:
                yield self._block(topic, messages)
        if unknown:
            self._report.tell(
                f'is damaged: {unknown} messages are left out, as nothing tells their topic or time'
            )

    def _rows(self, connection: sqlite3.Connection) -> Iterator[tuple[Any, Any, Any]]:
        """Yield topic, time and bytes of each message, up to where the file is damaged."""
        count = 0
        try:
            # By the table itself: an index may be damaged, and then says less than there is.
            query = 'SELECT topic_id, timestamp, data FROM messages NOT INDEXED'
            for row in connection.execute(query):
                count += 1
                yield row
        except sqlite3.Error as error:
            if not count:
                raise BagError(f'{self.path} cannot be read: {_said(error)}') from error
            self._report.tell(
                f'is damaged ({_said(error)}): only its first {count} messages are read'
            )

    def _block(self, topic: str, messages: list[tuple[int, bytes]]) -> MessageBlock:
        return MessageBlock(
            topic,
            self.types[topic],
            np.array([log_time for log_time, _ in messages], np.int64),
            np.zeros(len(messages), np.int64),
            Payloads.of(payload for _, payload in messages),
        )


def _size(row: tuple[Any, ...]) -> int:
    """Return the bytes of a row's texts and blobs."""
    return sum(len(value) for value in row if isinstance(value, (str, bytes)))


def _said(error: Exception) -> str:
    """Return what an error says, on one line: SQLite quotes the file."""
    return ' '.join(str(error).split())[:200]


def _is_message(number: object, log_time: object, payload: object) -> bool:
    """Tell whether a row has the kinds of values that it should: SQLite doesn't mind others."""
    return (
        isinstance(number, int)
        and isinstance(log_time, int)
        and abs(log_time) <= _LARGEST
        and isinstance(payload, bytes)
    )
