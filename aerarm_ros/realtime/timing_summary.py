"""What a set of measured durations looks like."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TimingSummary:
    """Durations [s] in a few numbers; all zero where nothing was measured.

    Attributes
    ----------
    count
        Durations measured.
    mean, std
        Mean and standard deviation [s].
    minimum, p50, p99, p999, maximum
        Smallest, median, 99 % and 99.9 % quantile, largest [s].
    """

    count: int = 0
    mean: float = 0.0
    std: float = 0.0
    minimum: float = 0.0
    p50: float = 0.0
    p99: float = 0.0
    p999: float = 0.0
    maximum: float = 0.0

    def __str__(self) -> str:
        """Return one line in microseconds."""
        fields = ('mean', 'std', 'p50', 'p99', 'p999', 'maximum')
        values = '  '.join(f'{name} {getattr(self, name) * 1e6:.0f}' for name in fields)
        return f'{values} us ({self.count} values)'
