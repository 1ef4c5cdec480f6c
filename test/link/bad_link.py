"""Two connections over a bad link, in simulated time."""

import random
from collections.abc import Callable
from pathlib import Path

from aerarm_ros.link.connection import PROMPT, Connection, Received, SentMessage

KEY = bytes(range(32))
TICK = 0.02  # [s]


class Link:
    """Drone and ground with losses, a delay and two clocks."""

    def __init__(self, loss: float = 0.0, delay: float = 0.01, seed: int = 0) -> None:
        self.drone = Connection(KEY, 'drone', 'ground', 26_000.0)
        self.ground = Connection(KEY, 'ground', 'drone', 9_000.0)
        self.up_delay = 0.0  # from ground to drone, besides [s]
        self.loss, self.delay, self.is_cut = loss, delay, False
        self.now = 100.0
        self.ahead = 0.0  # of the drone's system clock [s]
        self.drift = 0.0  # of the drone's monotonic clock [s]
        self.sent = 0
        self.came: dict[str, list[tuple[float, Received]]] = {'drone': [], 'ground': []}
        self.spy: list[tuple[str, bytes]] = []
        self._random = random.Random(seed)
        self._under_way: list[tuple[float, int, str, bytes]] = []

    def clocks(self, side: str) -> tuple[float, int, int]:
        now = self.now + (1000.0 + self.drift if side == 'drone' else 0.0)
        system = self.now + (self.ahead if side == 'drone' else 0.0)
        return now, round(1e9 * now), round(1e9 * system)

    def go(self, payload: bytes = b'go') -> SentMessage:
        """Send a command that expires after a second."""
        return self.ground.send(2, payload, PROMPT, expires=self.clocks('ground')[0] + 1.0)

    def cut(self, seconds: float) -> None:
        self.is_cut = True
        self.run(seconds)

    def run(self, seconds: float, until: Callable[[], object] = lambda: False) -> float:
        """Continue for a time, or until a condition; return the elapsed time [s]."""
        begin = self.now
        while self.now < begin + seconds - 1e-9 and not until():
            self.now += 0.005
            self._arrive()
            if round(self.now / 0.005) % round(TICK / 0.005) == 0:
                for side, end in (('drone', self.drone), ('ground', self.ground)):
                    self._send(side, end.datagram(*self.clocks(side)))
        return self.now - begin

    def _send(self, side: str, datagram: bytes) -> None:
        self.sent += 1
        other = 'ground' if side == 'drone' else 'drone'
        self.spy.append((other, datagram))
        if not self.is_cut and self._random.random() >= self.loss:
            delay = self.delay + (self.up_delay if side == 'ground' else 0.0)
            self._under_way.append((self.now + delay, self.sent, other, datagram))

    def _arrive(self) -> None:
        here = sorted(item for item in self._under_way if item[0] <= self.now)
        self._under_way = [item for item in self._under_way if item[0] > self.now]
        for _, _, side, datagram in here:
            end = getattr(self, side)
            for received in end.receive(datagram, *self.clocks(side)):
                self.came[side].append((self.now, received))
            if end.answer is not None:
                self._send(side, end.answer)

    def payloads(self, side: str) -> list[bytes]:
        return [received.payload for _, received in self.came[side]]


def same(one: Path, other: Path) -> bool:
    """Return whether two folders contain the same files."""
    files = [{path.name: path.read_bytes() for path in folder.iterdir()} for folder in (one, other)]
    return files[0] == files[1]
