"""Which commands reached a board, by the index that its answers echo."""

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

_INDICES = 0x10000
_MEMORY = 1000  # commands over which the rate of lost ones is averaged
# A rate above this means a loss in the last few thousand commands: one alone gives 1/1000.
_RECENT_RATE = 1e-4
_CHECK = 'check the MOSI wire, its connector, the ground wire and clock_hz'


class CommandEcho:
    """Counts the commands that did not reach one board although its answers reach the host.

    A board answers before it takes the command of the same exchange, so an answer echoes the
    command of the exchange before. A command is judged if its own exchange and the next one
    brought good answers: what failed both ways is a bad frame, and is not counted a second time.

    Parameters
    ----------
    name
        The board, for the texts.
    settings
        `lost_commands_max` and `lost_commands_warning` are used here.
    echoes
        False if the board's frames carry no index: then nothing is judged.

    Attributes
    ----------
    lost
        Commands lost since start.
    lost_in_row
        Commands lost since one arrived.
    rate
        Share of lost commands, averaged over about the last 1000 commands.
    unconfirmed
        Commands sent since the one that the board used when it answered last; 1 on good wires.
    """

    def __init__(self, name: str, settings: BridgeSettings, echoes: bool = True) -> None:
        self.lost = self.lost_in_row = 0
        self.rate = 0.0
        self.unconfirmed = 1
        self._name = name
        self._settings = settings
        self._echoes = echoes
        self._answered = False  # the exchange before

    @property
    def is_losing(self) -> bool:
        """Whether a command was lost in the last few seconds."""
        return self.rate > _RECENT_RATE

    @property
    def is_cut(self) -> bool:
        """Whether so many commands in a row were lost that it is a fault."""
        return self.lost_in_row >= self._settings.lost_commands_max

    @property
    def fault(self) -> str:
        """What a cut wire is called, without the board's name."""
        return (
            f'{self.lost_in_row} commands in a row did not reach it over MOSI while its answers '
            f'reach the host: {_CHECK}'
        )

    @property
    def warning(self) -> str:
        """What to say of the wire while too many commands are lost, '' else."""
        if self.is_cut:
            return f'{self._name}: {self.fault}'
        if self.rate <= self._settings.lost_commands_warning:
            return ''
        return (
            f'{self._name}: {100.0 * self.rate:.0f} % of the commands do not reach it over MOSI '
            f'while its answers reach the host: {_CHECK}'
        )

    def answered(self, echoed: int, sent: int) -> None:
        """Take the echo of a good answer; `sent` is the index of the exchange before."""
        if not self._echoes:
            return
        behind = (sent - echoed) % _INDICES
        if self._answered:
            is_lost = behind > 0
            self.lost += is_lost
            self.lost_in_row += 1
            self.rate += (is_lost - self.rate) / _MEMORY
        # A command whose own answer was lost may have arrived.
        self.lost_in_row = min(self.lost_in_row, behind)
        self.unconfirmed = behind + 1
        self._answered = True

    def missed(self) -> None:
        """Take note of an exchange without a good answer."""
        self.unconfirmed += 1
        self._answered = False
