"""Result folder of an identification, which is written completely or not at all."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType

from aerarm_ros.identification.errors import IdentificationError

MARKER = 'summary.json'


class ResultDirectory:
    """Context manager that collects files in a temporary folder, then replaces the result folder.

    Entering the context checks that the target can be written, before anything is computed. If an
    exception or an interrupt ends the context, the collected files are removed.

    Parameters
    ----------
    target : Path
        Target folder; may be missing, empty, or an earlier result, which is replaced.
    option : str
        Name of the command line option for the folder, for error messages.
    files : collection of str, optional
        Names of the files that an earlier result may contain; a folder with other files is not
        replaced. Without names, a folder is replaced if it contains the marker file.

    Attributes
    ----------
    replaced : bool
        Whether an earlier result exists and will be replaced; valid inside the context.

    Raises
    ------
    IdentificationError
        On entering, if the target cannot be written or contains other files.
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
        with self._writable('permissions, or name another folder with ' + self._option):
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
        return self

    @contextlib.contextmanager
    def _writable(self, advice: str) -> Iterator[None]:
        """Remove the collected files after an exception; convert an OSError."""
        try:
            yield
        except BaseException as error:
            self._remove()
            if not isinstance(error, OSError):
                raise
            raise IdentificationError(
                f'{self.target} cannot be written ({error.strerror or error}): check the {advice}'
            ) from None

    def _check_earlier(self) -> None:
        names = sorted(entry.name for entry in self.target.iterdir())
        others = [] if self._files is None else [n for n in names if n not in self._files]
        if others or not (self.target / MARKER).is_file():
            raise IdentificationError(
                f'{self.target} contains other files ({(others or names)[0]}) and is not '
                f'replaced: name another folder with {self._option}'
            )

    def path(self, name: str) -> Path:
        """Return the path for a file of the result that another program writes."""
        if self._collected is None:
            raise RuntimeError("files can only be written inside the 'with' block")
        return self._collected / name

    def write(self, name: str, text: str) -> None:
        """Write one text file into the result folder.

        Raises
        ------
        IdentificationError
            If the disk is full or the folder was removed.
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
        """Write a value as a JSON file into the result folder."""
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
            with self._writable('free space and permissions'):
                self._move_into_place(self._collected)

    def _make_parents(self, parent: Path) -> None:
        """Create missing folders, and record their names for removal after a failure."""
        missing = [folder for folder in (parent, *parent.parents) if not folder.exists()]
        for folder in reversed(missing):
            # recorded before it is made, because an interrupt may occur between the two calls
            self._made.append(folder)
            folder.mkdir()

    def _move_into_place(self, collected: Path) -> None:
        if self.target.exists():
            # Two renames, so that old and new results are never mixed.
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
            # the folder was not created, or contains other files by now
            with contextlib.suppress(OSError):
                folder.rmdir()
