"""What reading and writing bags can say to the user."""


class BagError(ValueError):
    """A bag that can't be read or written; the message says what to check."""


class BagWarning(UserWarning):
    """A bag that was read, but not all of it."""
