"""Relay that drops and delays datagrams between a port of this host and another address.

Usage: python benchmarks/radio/lossy_relay.py LISTENING_PORT TARGET_ADDRESS TARGET_PORT

Lines on standard input change its settings: `loss 0.05`, `delay 0.02` [s], `cut 1`.
"""

import asyncio
import random
import sys


class _Side(asyncio.DatagramProtocol):
    """Socket of the relay that forwards received datagrams to the other socket."""

    def __init__(self, relay: 'Relay', target: tuple[str, int] | None) -> None:
        self.transport: asyncio.DatagramTransport | None = None
        self.other: _Side | None = None
        self.peer = target
        self._is_fixed = target is not None
        self._relay = relay

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, address: tuple[str, int]) -> None:
        if not self._is_fixed:
            self.peer = address
        if self.other is not None:
            self._relay.forward(self.other, data)


class Relay:
    """Relay with a loss rate, a delay and a cut-off."""

    def __init__(self) -> None:
        self.values = {'loss': 0.0, 'delay': 0.0, 'cut': 0.0}
        self._random = random.Random(1)

    def forward(self, side: _Side, data: bytes) -> None:
        """Send a datagram to one side, with delay, or drop it."""
        if self.values['cut'] or self._random.random() < self.values['loss']:
            return
        asyncio.get_running_loop().call_later(self.values['delay'], self._send, side, data)

    @staticmethod
    def _send(side: _Side, data: bytes) -> None:
        if side.transport is not None and side.peer is not None:
            side.transport.sendto(data, side.peer)

    async def run(self, port: int, target: tuple[str, int]) -> None:
        """Relay until standard input ends."""
        loop = asyncio.get_running_loop()
        near, far = _Side(self, None), _Side(self, target)
        near.other, far.other = far, near
        await loop.create_datagram_endpoint(lambda: near, local_addr=('0.0.0.0', port))
        await loop.create_datagram_endpoint(lambda: far, local_addr=('0.0.0.0', 0))
        print('ready', flush=True)
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            name, value = line.split()
            self.values[name] = float(value)


if __name__ == '__main__':
    asyncio.run(Relay().run(int(sys.argv[1]), (sys.argv[2], int(sys.argv[3]))))
