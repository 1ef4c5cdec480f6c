"""A result folder that is there completely or not at all."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Collection
from pathlib import Path
from types import TracebackType

from aerarm_ros.identification.errors import IdentificationError

MARKER = 'summary.json'


class ResultDirectory:
    """Context that collects files in a temporary folder and moves them to the target at its end.

    Entering it makes sure at once, before anything is computed, that the place can be
    written. Leaving it by an exception, an interrupt included, removes what was collected.

    Parameters
    ----------
    target : Path
        May be missing, empty, or an earlier result, which is replaced.
    option : str
        How the user names the folder, for errors.
    files : collection of str, optional
        All that an earlier result may hold; anything else in the folder is not replaced. Only
        the marker counts without it.

    Attributes
    ----------
    replaced : bool
        Whether an earlier result was there; known once the context is entered.

    Raises
    ------
    IdentificationError
        On entering, if the place can't be written or holds something else.
    """

    def __init__(
        self, target: Path, option: str = '--out', files: Collection[str] | None = None
    ) -> None:
        self.target = target.absolute()
        self.replaced = False
        self._option = option
        self._files = files
        self._collected: Path | None = None
        self._made: list[Path] = []

    def __enter__(self) -> 'ResultDirectory':
        parent = self.target.parent
        try:
            if self.target.is_dir() and any(self.target.iterdir()):
                self._check_earlier()
                self.replaced = True
            elif self.target.exists() and not self.target.is_dir():
                raise IdentificationError(
                    f'{self.target} is a file: name a folder with {self._option}'
                )
            self._make_parents(parent)
            prefix = f'.{self.target.name}.'
            self._collected = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
            self._collected.chmod(0o755)
        except OSError as error:
            self._remove()
            raise IdentificationError(
                f'{self.target} cannot be written ({error.strerror or error}): check the '
                f'permissions, or name another folder with {self._option}'
            ) from None
        except KeyboardInterrupt:
            self._remove()
            raise
        return self

    def _check_earlier(self) -> None:
        names = sorted(entry.name for entry in self.target.iterdir())
        others = [] if self._files is None else [n for n in names if n not in self._files]
        if others or not (self.target / MARKER).is_file():
            raise IdentificationError(
                f'{self.target} contains other files ({(others or names)[0]}) and is not '
                f'replaced: name another folder with {self._option}'
            )

    def path(self, name: str) -> Path:
        """Return where a part of the result that others write is to be put."""
        if self._collected is None:
            raise RuntimeError("files can only be written inside the 'with' block")
        return self._collected / name

    def write(self, name: str, text: str) -> None:
        """Write one file of the result.

        Raises
        ------
        IdentificationError
            If the disk is full or the place has gone.
        """
        path = self.path(name)
        try:
            path.write_text(text, encoding='utf-8')
        except OSError as error:
            raise IdentificationError(
                f'{self.target / name} cannot be written ({error.strerror or error}): check the '
                'free space and permissions'
            ) from None

    def write_json(self, name: str, value: object) -> None:
        """Write one file as JSON."""
        self.write(name, json.dumps(value, indent=2, allow_nan=False) + '\n')

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._remove()
        elif self._collected is not None:
            try:
                self._move_into_place(self._collected)
            except OSError as failure:
                self._remove()
                raise IdentificationError(
                    f'{self.target} cannot be written ({failure.strerror or failure}): '
                    'check the free space and permissions'
                ) from None

    def _make_parents(self, parent: Path) -> None:
        """Make missing folders and remember them, so that a failure leaves none behind."""
        missing = [folder for folder in (parent, *parent.parents) if not folder.exists()]
        for folder in reversed(missing):
            self._made.append(folder)  # before: an interruption may come between the two
            folder.mkdir()

    def _move_into_place(self, collected: Path) -> None:
        if self.target.exists():
            # Two renames: at no moment is there a mixture of the old and the new result.
            old = collected.with_name(collected.name + '.old')
            os.rename(self.target, old)
            os.rename(collected, self.target)
            shutil.rmtree(old, ignore_errors=True)
        else:
            os.rename(collected, self.target)

    def _remove(self) -> None:
        if self._collected is not None:
            shutil.rmtree(self._collected, ignore_errors=True)
        for folder in reversed(self._made):
            with contextlib.suppress(OSError):  # it was not made, or holds more by now
                folder.rmdir()
