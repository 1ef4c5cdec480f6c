"""Every frame of a run, decoded without the suite's codec."""

from pathlib import Path

import numpy as np
from crc_table import crc32_mpeg2_rows

TURN = 2.0 * np.pi
KRPM = 1000.0 * TURN / 60.0  # [rad/s]
_WORDS = np.dtype('>u2')


class FrameLog:
    """Frames exchanged with each board, and their times.

    The frames are decoded by the layout of profile uomodri_v3 in docs/reference/frames.md, not by
    `FrameCodec`, so errors of the codec are visible.

    Attributes
    ----------
    rows
        Of each exchange: true time [s], board, bytes sent, bytes received.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[float, int, bytes, bytes]] = []

    def add(self, time: float, board: int, sent: bytes, received: bytes) -> None:
        """Record an exchange at a true time [s]."""
        self.rows.append((time, board, sent, received))

    def times(self, board: int) -> np.ndarray:
        """Return the true times [s] of the exchanges with a board, (M,)."""
        return np.array([row[0] for row in self.rows if row[1] == board])

    def commands(self, board: int) -> dict[str, np.ndarray]:
        """Return the commands to a board, (M,) or (M, 2) by channel, in SI units, motor side.

        Keys: good (the CRC is right), enable_system, enable_motor, timeout [s], position,
        velocity, current, kp, kd, current_saturation, index.
        """
        sent = [row[2] for row in self.rows if row[1] == board]
        table = np.frombuffer(b''.join(sent), np.uint8).reshape(len(sent), 34)
        words = table.view(_WORDS).astype(np.int64)
        first = words[:, 0]
        return {
            'good': crc32_mpeg2_rows(table[:, :30]) == (words[:, 15] << 16 | words[:, 16]),
            'enable_system': (first >> 15 & 1).astype(bool),
            'enable_motor': np.stack([first >> 14 & 1, first >> 13 & 1], axis=1).astype(bool),
            'timeout': 1e-3 * (first & 0xFF),
            'position': _signed(words[:, [1, 3]] << 16 | words[:, [2, 4]], 32) * 2.0**-24 * TURN,
            'velocity': _signed(words[:, 5:7], 16) * 2.0**-11 * KRPM,
            'current': _signed(words[:, 7:9], 16) * 2.0**-10,
            'kp': words[:, 9:11] * 2.0**-11 / TURN,
            'kd': words[:, 11:13] * 2.0**-10 / KRPM,
            'current_saturation': np.stack([words[:, 13] >> 8, words[:, 13] & 0xFF], axis=1) / 8.0,
            'index': words[:, 14],
        }

    def write(self, path: Path) -> None:
        """Write the rows as text: time, board, sent, received, in hexadecimal."""
        lines = [f'{t:.6f} {board} {sent.hex()} {got.hex()}\n' for t, board, sent, got in self.rows]
        path.write_text(''.join(lines))


def _signed(values: np.ndarray, bits: int) -> np.ndarray:
    return values - (values >> bits - 1 << bits)
