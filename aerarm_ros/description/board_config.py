"""One control board."""

from dataclasses import dataclass

from aerarm_ros.description.config_error import check_choice, check_name, check_range

ENCODERS = ('incremental', 'absolute')


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """A dual-motor control board on its SPI bus.

    Attributes
    ----------
    name : str
    device : str
        Device file, e.g. '/dev/spidev0.0' (bus 0, chip select 0).
    clock_hz : int
        SPI clock [Hz].
    mode : int
        SPI mode 0-3 (clock polarity and phase).
    encoders : str
        'incremental' if they count from where the board was switched on, 'absolute' if they know
        their angle then; '' for what the frame profile says.

    Raises
    ------
    ConfigError
        If a value lies outside its range.
    """

    name: str
    device: str
    clock_hz: int
    mode: int
    encoders: str = ''

    def __post_init__(self) -> None:
        """Check every value."""
        check_name('board', 'name', self.name)
        owner = f'board {self.name}'
        check_name(owner, 'device', self.device)
        check_range(owner, 'clock_hz', self.clock_hz, 100_000, 50_000_000, 'Hz')
        check_choice(owner, 'mode', self.mode, (0, 1, 2, 3))
        check_choice(owner, 'encoders', self.encoders, ('', *ENCODERS))
