"""Why there is no plan."""


class PlanError(ValueError):
    """A goal cannot be reached as asked; the message says which limit is in the way."""
