"""What of a file could not be read, said while it is met."""

import warnings
from pathlib import Path

from aerarm_msgs_py.storage.bag_error import BagWarning

_TOLD = 5  # one by one; a file may be damaged at many thousand places


class DamageReport:
    """Warnings about one file.

    Parameters
    ----------
    path
        The file, for messages.

    Attributes
    ----------
    places
        How often something was missing or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.places = 0
        self._path = path
        self._lost = 0

    def tell(self, what: str, lost: int = 0) -> None:
        """Warn of damage, and of the bytes that are lost by it."""
        self.places += 1
        self._lost += lost
        if self.places <= _TOLD:
            warnings.warn(f'{self._path} {what}', BagWarning, stacklevel=2)

    def finish(self) -> None:
        """Sum up what was not told one by one."""
        if self.places > _TOLD:
            warnings.warn(
                f'{self._path} is damaged at {self.places} places in all, where {self._lost} '
                'bytes are left out',
                BagWarning,
                stacklevel=2,
            )
