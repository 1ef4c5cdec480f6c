"""What may stand before the names of an arm's links and joints, to tell it from another arm."""

import re

from aerarm_ros.description.description_error import DescriptionError

_LONGEST = 64  # characters
_PREFIX = re.compile(r'([A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*/?)?')


def check_prefix(prefix: str) -> None:
    """Require a prefix with which every name is one that ROS's frames may have.

    Raises
    ------
    DescriptionError
        If it holds anything but letters, digits, underscores and single slashes, begins with
        another than a letter, or is very long. Nothing at all is fine.
    """
    if len(prefix) > _LONGEST or not _PREFIX.fullmatch(prefix):
        raise DescriptionError(
            f'tf_prefix {prefix[:_LONGEST]!r} cannot stand before names of frames and joints: it '
            'needs a letter first, then letters, digits, _ and single / only, as left_'
        )
