"""A system clock that a test sets only for the processes that it starts."""

import mmap
import struct
import subprocess
from pathlib import Path

from spi_boards import FLAGS, compiler

_SOURCE = Path(__file__).parents[1] / 'hardware' / 'clock_shim.c'
_OFFSET = struct.Struct('=q')


class SetClock:
    """The offset of the system clock of processes with `environment`, see clock_shim.c."""

    def __init__(self, folder: Path) -> None:
        shim, offset = folder / 'clock_shim.so', folder / 'offset'
        subprocess.run([compiler(), *FLAGS, '-o', shim, _SOURCE, '-ldl'], check=True)
        offset.write_bytes(_OFFSET.pack(0))
        with offset.open('r+b') as file:
            self._memory = mmap.mmap(file.fileno(), _OFFSET.size)
        self.environment = {'LD_PRELOAD': str(shim), 'CLOCK_SHIM_OFFSET': str(offset)}

    def set(self, offset: float) -> None:
        """Set the offset of the system clock from the kernel's [s]."""
        self._memory[:] = _OFFSET.pack(round(offset * 1e9))
