"""A bag fetched over a bad link, in simulated time."""

import contextlib
import os
import random
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bad_link import same

from aerarm_ros.link.fetch import BLOCK, Fetch, FileServer, questions

TICK = 0.02


class Radio:
    """A link with loss, delay, a rate and a queue, between a server and a fetch."""

    def __init__(self, folder: Path, loss: float = 0.0, rate: float = 1e9) -> None:
        self.folder, self.server = folder, FileServer(folder, 3)
        self.loss, self.rate = loss, rate  # rate in bytes/s
        self.now, self.free_at = 10.0, 0.0
        self.delay = self.longest = 0.0
        self.is_cut = False
        self.blocks = 0
        self._random = random.Random(1)
        self._under_way: list[tuple[float, bytes]] = []

    def run(self, fetch: Fetch, seconds: float, until: Callable[[], object]) -> float:
        begin = self.now
        while self.now < begin + seconds and not until():
            while fetch.is_storing:  # the disk takes real time
                time.sleep(1e-4)
                fetch.question(self.now, self.delay, 0.02)
            self.now += TICK
            arrived = [item for item in self._under_way if item[0] <= self.now]
            self._under_way = [item for item in self._under_way if item[0] > self.now]
            for _, answer in arrived:
                self.delay = self._queue()
                fetch.take(answer)
            question = fetch.question(self.now, self.delay, 0.02)
            if question is None or self.is_cut or self._random.random() < self.loss:
                continue
            number, places = questions(question)
            for place in places if number == 3 else ():
                self._send(self.server.answer(place))
        return self.now - begin

    def _queue(self) -> float:
        return max(0.0, self.free_at - self.now)

    def _send(self, answer: bytes) -> None:
        self.blocks += 1
        self.free_at = max(self.free_at, self.now) + len(answer) / self.rate
        self.longest = max(self.longest, self._queue())
        if self._random.random() >= self.loss:
            self._under_way.append((self.free_at + 0.01, answer))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    folder = tmp_path / 'drone' / 'bag'
    folder.mkdir(parents=True)
    (folder / 'bag_0.mcap').write_bytes(random.Random(2).randbytes(300 * BLOCK + 17))
    (folder / 'metadata.yaml').write_bytes(b'rosbag2')
    (folder / 'empty').touch()
    return folder


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """Return the folder of the bag on the ground."""
    return tmp_path / 'ground'


def fetch_into(radio: Radio, folder: Path, rate: float = 500.0) -> Fetch:
    return Fetch(folder, 3, radio.server.manifest, rate)


def complete(radio: Radio, fetch: Fetch, seconds: float = 60.0) -> None:
    """Fetch the rest of the bag, and compare it with the original."""
    assert radio.run(fetch, 2.0 * seconds, lambda: fetch.is_complete) < seconds
    assert same(radio.folder, fetch._folder)


@pytest.mark.parametrize('loss', [0.0, 0.2, 0.5])
def test_a_bag_is_fetched_completely_also_through_a_cut(bag, here, loss: float) -> None:
    radio = Radio(bag, loss)
    fetch = fetch_into(radio, here, 100.0)
    radio.run(fetch, 1.0, lambda: False)
    before, radio.is_cut = fetch.stored, True
    radio.run(fetch, 5.0, lambda: False)
    assert fetch.stored - before < 50 * BLOCK
    radio.is_cut = False
    complete(radio, fetch)
    assert fetch.stored == fetch.size == 300 * BLOCK + 17 + 7


def test_a_restarted_fetch_continues_after_the_stored_blocks(bag, here) -> None:
    radio = Radio(bag)
    first = fetch_into(radio, here, 100.0)
    radio.run(first, 60.0, lambda: first.stored > 100 * BLOCK)
    first.close()
    second = fetch_into(radio, here)
    assert second.stored > 90 * BLOCK
    radio.run(second, 60.0, lambda: second.is_storing)
    second.close()
    blocks = radio.blocks
    third = fetch_into(radio, here)  # what was received, but not stored, is only stored
    complete(radio, third)
    assert radio.blocks - blocks <= 2
    assert radio.blocks < 420
    assert fetch_into(radio, here).is_complete


def test_a_slow_disk_does_not_hold_up_the_connection(bag, here, monkeypatch) -> None:
    is_stored = threading.Event()
    monkeypatch.setattr('os.fsync', lambda _: is_stored.wait())
    radio = Radio(bag)
    fetch = fetch_into(radio, here)
    radio.run(fetch, 60.0, lambda: fetch.is_storing)
    assert fetch.question(radio.now, 0.0, 0.02) is None
    is_stored.set()
    complete(radio, fetch)


def test_unrequested_and_random_blocks_take_no_memory(bag, here) -> None:
    (bag / 'bag_0.mcap').write_bytes(bytes(5000 * BLOCK))
    radio = Radio(bag)
    fetch: Any = fetch_into(radio, here)
    source = random.Random(8)
    head = struct.pack('<H', 3)
    for _ in range(3000):
        content = head * source.randrange(2) + source.randbytes(source.randrange(40))
        with contextlib.suppress(struct.error):  # the only documented error
            fetch.take(content)
        with contextlib.suppress(struct.error, IndexError, OSError):
            for place in questions(content)[1]:
                radio.server.answer(place)
    for block in range(1, 5000):
        fetch.take(struct.pack('<HHI', 3, 0, block) + bytes(BLOCK))
    assert len(fetch._waiting) < 512
    assert fetch.stored == 0
    radio.server.close()


@pytest.mark.parametrize(
    'manifest',
    [
        *([], [['a']], [['a', 1, 2]], [['a', -1]], [['a', 'x']], [['a', 1], ['a', 2]], 5, None),
        *([['a', 1 << 60]], [['a', float('inf')]], {'a': 1, 'b': 2}),
        *([[name, 5]] for name in ('../x', '/etc/passwd', '.hidden', '', 'a/b', 'a' * 101)),
    ],
)
def test_an_invalid_manifest_is_an_error(manifest: Any, here) -> None:
    with pytest.raises(ValueError, match='the drone sent an invalid list of files'):
        Fetch(here, 1, manifest, 10.0)
    assert not here.exists()


def test_a_slow_radio_gets_no_queue_that_delays_commands(bag, here) -> None:
    radio = Radio(bag, rate=30_000.0)  # bytes/s; 500 blocks/s would be 17 times that
    complete(radio, fetch_into(radio, here), 30.0)  # 10 s at the full rate
    assert radio.longest < 0.6


def test_files_of_another_recording_are_neither_replaced_nor_continued(bag, here) -> None:
    radio = Radio(bag)
    fetch = fetch_into(radio, here, 100.0)
    radio.run(fetch, 60.0, lambda: fetch.stored > 100 * BLOCK)
    fetch.close()
    (bag / 'bag_0.mcap').write_bytes(random.Random(5).randbytes(200 * BLOCK))
    other = Radio(bag)
    again = fetch_into(other, here)
    assert again.stored == 0
    complete(other, again)
    (here / 'bag_0.mcap').write_bytes(b'recorded on the ground')
    with pytest.raises(ValueError, match='bag_0.mcap belongs to another recording'):
        fetch_into(other, here)
    assert (here / 'bag_0.mcap').read_bytes() == b'recorded on the ground'


def test_a_file_that_grows_is_fetched_as_it_was(bag, here) -> None:
    radio = Radio(bag)
    fetch = fetch_into(radio, here)
    with (bag / 'metadata.yaml').open('ab') as stream:
        stream.write(b' and more')
    radio.run(fetch, 60.0, lambda: fetch.is_complete)
    assert (here / 'metadata.yaml').read_bytes() == b'rosbag2'


@pytest.mark.skipif(not hasattr(os, 'RWF_NOWAIT'), reason='reading without waiting: Linux only')
def test_a_block_that_the_disk_must_read_first_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / 'bag_0.mcap'
    content = random.Random(3).randbytes(400 * BLOCK)
    path.write_bytes(content)
    server = FileServer(tmp_path, 3)
    first = struct.pack('<HI', 0, 0)
    with path.open('rb') as file:
        os.fsync(file.fileno())

        def waits(read: Callable[[], object]) -> bool:
            """Return whether `read` raises BlockingIOError for a file outside the page cache."""
            for _ in range(100):
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
                try:
                    read()
                except BlockingIOError:
                    return True
                time.sleep(0.01)  # a page in use stays in the cache
            return False

        if not waits(lambda: os.preadv(file.fileno(), [bytearray(BLOCK)], 0, os.RWF_NOWAIT)):
            pytest.skip('the folder of temporary files is in memory')
        assert waits(lambda: server.answer(first))
    came, deadline = bytearray(), time.monotonic() + 20.0
    while len(came) < len(content):
        assert time.monotonic() < deadline
        with contextlib.suppress(BlockingIOError):
            came += server.answer(struct.pack('<HI', 0, len(came) // BLOCK))[8:]
    assert came == content
    server.close()
