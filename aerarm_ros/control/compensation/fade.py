"""What comes and goes without a jump."""


class Fade:
    """A share that moves to 1 or to 0 at a steady pace.

    Parameters
    ----------
    duration : float
        From 0 to 1 [s], positive.
    share : float
        At first, 0 to 1.

    Attributes
    ----------
    share : float
        Now, 0 to 1; may be set where nothing can jump.
    """

    def __init__(self, duration: float, share: float) -> None:
        self._rate = 1.0 / duration
        self.share = share

    def update(self, dt: float, is_on: bool) -> float:
        """Move on for a cycle of `dt` [s], toward 1 if it `is_on`, and return the share."""
        change = self._rate * dt
        self.share = min(1.0, self.share + change) if is_on else max(0.0, self.share - change)
        return self.share
