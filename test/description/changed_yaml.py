"""Packaged YAML files with changed values."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml

from aerarm_ros.description.resources import resource

MISSING = object()
"""Value of a key that is deleted."""


def changed_yaml(folder: Path, name: str, changes: Mapping[str, object]) -> Path:
    """Write a file of `config` to a folder, with other values at some dotted keys."""
    document = yaml.safe_load(resource('config', name).read_text())
    for key, value in changes.items():
        place: Any = document
        *path, last = (int(part) if part.isdigit() else part for part in key.split('.'))
        for part in path:
            place = place[part]
        if value is MISSING:
            del place[last]
        else:
            place[last] = deepcopy(value)
    changed = folder / f'my_{name}'
    changed.write_text(yaml.safe_dump(document))
    return changed
