"""Zero-phase filtering, differentiation and decimation of sampled signals, thesis section 3.5."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aerarm_ros.motion.signals import Array

Gain = npt.NDArray[np.float64] | npt.NDArray[np.complex128]

# The impulse response of the low-pass filter decays within this many cut-off periods.
SETTLING_PERIODS = 6.0
# After this many, the response to a jump at a part's end is below rounding.
MEMORY_PERIODS = 2.0 * SETTLING_PERIODS
_BATCH = 1_000_000  # values filtered at once, to limit the memory
# Samples of a part of a long signal. Its transform stays in the processor's cache, which makes it
# three to six times as fast per sample as that of a million samples.
_PART = 32768
_ORDER = 4  # of a low-pass filter in each direction
_MARGINS_PER_PART = 16  # smallest size of a part in margins, which are computed in vain


def low_pass_gain(cutoff: float) -> Callable[[Array], Array]:
    """Return the gain of a Butterworth low-pass filter that is applied forwards and backwards.

    Parameters
    ----------
    cutoff : float
        Frequency [Hz] at which the total gain is 1/2 (each run has 1/sqrt(2)).

    Returns
    -------
    callable
        Maps frequencies [Hz] to real gains, without phase shift.
    """

    def gain(frequency: Array) -> Array:
        return np.asarray(1.0 / (1.0 + (frequency / cutoff) ** (2 * _ORDER)))

    return gain


def harmonic_gain(fundamental: float, harmonics: int) -> Callable[[Array], Array]:
    """Return the gain of the filter that passes only known harmonics, thesis figure 3.2.

    Parameters
    ----------
    fundamental : float
        Fundamental frequency f0 [Hz].
    harmonics : int
        Number N; only the constant and the frequencies f0 .. N f0 pass.

    Returns
    -------
    callable
        Maps frequencies [Hz] of a record of whole periods to gains of 0 or 1.
    """

    def gain(frequency: Array) -> Array:
        order = frequency / fundamental
        nearest = np.round(order)
        return np.asarray(
            (np.abs(order - nearest) < 1e-6 * (1.0 + nearest)) & (nearest <= harmonics), float
        )

    return gain


class SpectralFilter:
    """Zero-phase filter, applied in the frequency domain.

    A periodic signal has an exact spectrum. From any other signal the straight line between its
    ends is subtracted before filtering, and added again afterwards. The remaining signal is
    extended by point reflection (odd extension), which keeps value and slope continuous.
    For decimation, the frequencies above the new Nyquist frequency are omitted, which prevents
    aliasing.

    Parameters
    ----------
    count : int
        Number of samples of the signals.
    dt : float
        Sampling time [s].
    gain : callable
        Maps frequencies [Hz] to gains, 1 for constants, for example `low_pass_gain(5.0)`; complex
        gains shift in time.
    decimation : int
        Decimation factor; it must divide `count` for a periodic signal.
    settling : float or None
        Length of the extension [s]; None for a periodic signal.
    memory : float or None
        Time [s] after which the impulse response has decayed; None if it does not, as that of
        windows in the frequency domain. With it, long signals are filtered in parts that overlap by
        this time. The result is the same, with decimation to about a millionth of the signal.

    Attributes
    ----------
    periodic : bool
        Whether the filter treats signals as periodic.

    Raises
    ------
    ValueError
        If `decimation` does not divide the length of a periodic signal.
    """

    def __init__(
        self,
        count: int,
        dt: float,
        gain: Callable[[Array], Gain],
        decimation: int = 1,
        settling: float | None = None,
        memory: float | None = None,
    ) -> None:
        self.memory = memory
        self._same = (dt, gain, decimation, settling, memory)
        self.count = count
        self.dt = dt
        self.decimation = decimation
        self.periodic = settling is None
        if settling is None:
            if count % decimation:
                raise ValueError(f'{count} periodic samples cannot be decimated by {decimation}')
            self._left, self._length = 0, count
        else:
            self._left, self._length = _continuation(count, settling / dt, decimation)
        self._margin, self._size = 0, self._length  # overlap and length of a part
        if memory is not None:
            margin = -(-round(memory / dt) // decimation) * decimation
            size = _smooth_multiple(decimation, max(_PART, _MARGINS_PER_PART * margin))
            if 2 * size < self._length:
                self._margin, self._size = margin, size
        frequency: Array = np.asarray(np.fft.rfftfreq(self._size, dt), dtype=float)
        self._gain = gain(frequency)
        self._omega = 2.0 * np.pi * frequency

    def for_count(self, count: int) -> 'SpectralFilter':
        """Return a copy of the filter for signals of `count` samples."""
        return SpectralFilter(count, *self._same)

    def __call__(self, signal: npt.ArrayLike, derivative: int = 0, decimate: bool = True) -> Array:
        """Filter a signal along its first axis.

        Parameters
        ----------
        signal : (count, ...) array_like
            Uniform samples.
        derivative : int
            Order of differentiation, by multiplication with (j omega), section 3.5.1.
        decimate : bool
            Whether to decimate; False keeps the sampling rate.

        Returns
        -------
        (ceil(count / decimation), ...) ndarray
            Filtered signal, in the signal's unit divided by s^derivative.
        """
        signal = np.asarray(signal, dtype=float)
        step = self.decimation if decimate else 1
        columns = signal.reshape(self.count, -1)
        result = np.empty((-(-self.count // step), columns.shape[1]))
        gain = self._gain * (1j * self._omega) ** derivative if derivative else self._gain
        if derivative and self._size % 2 == 0:
            # the sign of the Nyquist frequency is undefined, so its derivative is set to zero
            gain[-1] = 0.0
        batch = max(1, _BATCH // self._length)
        for first in range(0, columns.shape[1], batch):
            part = slice(first, first + batch)
            result[:, part] = self._filtered(columns[:, part].T, derivative, gain, step).T
        return result.reshape(-1, *signal.shape[1:])

    def _filtered(self, rows: Array, derivative: int, gain: Gain, step: int) -> Array:
        if self.periodic:
            return self._apply(np.ascontiguousarray(rows), gain, step)
        slope = (rows[:, -1:] - rows[:, :1]) / (self.count - 1)
        line = rows[:, :1] + slope * np.arange(self.count)
        filtered = self._apply(self._continued(rows - line), gain, step)
        if derivative == 0:
            filtered += line[:, ::step]
        elif derivative == 1:
            filtered += slope / self.dt
        return filtered

    def _apply(self, rows: Array, gain: Gain, step: int) -> Array:
        """Filter extended rows of a signal; long rows are filtered in overlapping parts."""
        last = self._left + self.count
        if self._size == self._length:
            return _transformed(rows, gain, step)[:, self._left // step : -(-last // step)]
        result = np.empty((len(rows), -(-self.count // step)))
        body = self._size - 2 * self._margin
        for first in range(self._left, last, body):
            place = np.arange(first - self._margin, first + body + self._margin)
            part = _transformed(np.take(rows, place, axis=1, mode='wrap'), gain, step)
            begin = (first - self._left) // step
            own = result[:, begin : begin + body // step]
            own[:] = part[:, self._margin // step :][:, : own.shape[1]]
        return result

    def _continued(self, rows: Array) -> Array:
        left, right = self._left, self._length - self._left - self.count
        extended = np.empty((len(rows), self._length))
        extended[:, left : left + self.count] = rows
        # Both ends are zero now, so reflection about them changes the sign.
        extended[:, :left] = -rows[:, left:0:-1]
        last = self.count - 1
        if right:
            mirrored = rows[:, last - 1 : last - 1 - right if right < last else None : -1]
            extended[:, left + self.count :] = -mirrored
        return extended


def _transformed(rows: Array, gain: Gain, step: int) -> Array:
    """Multiply the spectrum of periodic rows by `gain`, and return one of `step` samples."""
    length = rows.shape[1] // step
    kept = length // 2 + 1
    spectrum = np.fft.rfft(rows, axis=1)[:, :kept]
    spectrum *= gain[:kept]
    if step > 1 and length % 2 == 0:
        # One of two conjugate bins remains at the new Nyquist frequency.
        spectrum[:, -1] = spectrum[:, -1].real * 2.0
    return np.asarray(np.fft.irfft(spectrum, length, axis=1) / step)


def _smooth_multiple(factor: int, least: int) -> int:
    """Return a multiple of `factor`, at least `least`, as length of a fast Fourier transform."""
    multiple = -(-least // factor)
    while not _is_smooth(multiple):
        multiple += 1
    return multiple * factor


def _continuation(count: int, wanted: float, decimation: int) -> tuple[int, int]:
    """Return the number of samples to add before the signal, and the length after extension."""
    most = count - 1
    left = min(round(wanted), most) // decimation * decimation
    shortest, longest = left + count + min(round(wanted), most), left + count + most
    first = -(-shortest // decimation) * decimation
    lengths = range(first, longest + 1, decimation)
    for length in lengths[:2000]:
        if _is_smooth(length):
            return left, length
    if len(lengths):
        return left, lengths[0]
    # There are too few samples after the signal for a multiple of the decimation, so fewer are
    # added before it.
    return left, (left + count + most) // decimation * decimation


def _is_smooth(number: int) -> bool:
    """Return whether the Fourier transform of this length is fast: no prime factor is above 7."""
    for factor in (2, 3, 5, 7):
        while number % factor == 0:
            number //= factor
    return number == 1
