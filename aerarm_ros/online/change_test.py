"""When something is no longer what it was."""


class ChangeTest:
    """A cumulative sum of how much larger errors are than they should be.

    Page: Continuous inspection schemes (1954). An error counts by its square over its variance,
    less `allowed`, and up to a limit: one sample that is mad finds nothing.

    Parameters
    ----------
    allowed : float
        Mean of squared errors over their variance that is still in order.
    threshold : float
        Sum that tells a change.
    """

    def __init__(self, allowed: float = 5.0, threshold: float = 60.0) -> None:
        self._allowed = allowed
        self._threshold = threshold
        self._sum = 0.0

    def reset(self) -> None:
        """Begin anew."""
        self._sum = 0.0

    def update(self, square: float) -> bool:
        """Take a squared error over its variance, and tell whether there was a change."""
        change = min(square, 0.5 * self._threshold) - self._allowed
        self._sum = max(0.0, self._sum + change)
        return self._sum > self._threshold
