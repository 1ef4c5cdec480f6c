"""The error of every input a controller does not follow."""


class RejectedInputError(ValueError):
    """A reference or sensor sample that is not used; the message says why and what to check.

    Whoever raises it has changed nothing: the arm keeps doing what it did.
    """
