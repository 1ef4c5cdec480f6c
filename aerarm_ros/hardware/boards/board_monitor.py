"""Follows what state a board is in."""

from collections.abc import Sequence
from enum import StrEnum
from math import inf

from aerarm_ros.hardware.frames.board_messages import BoardState
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings


class BoardMode(StrEnum):
    """From no contact to driving motors; a fault stays until it is cleared."""

    DISCONNECTED = 'disconnected'
    IDLE = 'idle'
    ALIGNING = 'aligning'
    READY = 'ready'
    RUNNING = 'running'
    FAULT = 'fault'


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
        """Name of the fault of a cut wire, without the board's name."""
        return (
            f'{self.lost_in_row} consecutive commands did not reach the board over MOSI, '
            f'although its answers reach the host: {_CHECK}'
        )

    @property
    def warning(self) -> str:
        """Warning about the wire while too many commands are lost, else ''."""
        if self.is_cut:
            return f'{self._name}: {self.fault}'
        if self.rate <= self._settings.lost_commands_warning:
            return ''
        return (
            f'{self._name}: {100.0 * self.rate:.0f} % of the commands do not reach the board '
            f'over MOSI, although its answers reach the host; {_CHECK}'
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


_ADVICE = 'check supply, wires and SPI mode'


class BoardMonitor:
    """State machine of one board, driven by its frames; a fault is latched.

    disconnected -> idle once it answers well; idle -> aligning -> ready when the system is
    enabled and until every motor in use is aligned; ready <-> running while a command is
    followed. Back to idle when it is disabled. An error code, too many bad frames, too many
    commands that do not reach a driven board, frozen data, a slow bus or motors that are no longer
    ready lead to fault.

    Silence is counted in exchanges that failed. Time in which the host was held up and asked
    nothing says nothing about a board.

    Parameters
    ----------
    name
        For the texts.
    profile
        Meaning of error codes.
    channels
        The motors in use, 0 and 1.
    settings
        Tolerances.

    Attributes
    ----------
    mode
        The state.
    fault
        What happened and what to check; '' unless the mode is fault.
    problem
        What the bus says about the last bad frame, or what to check.
    good_frames, bad_frames, slow_exchanges
        Counts since start.
    echo
        Which commands reached the board.
    """

    def __init__(
        self, name: str, profile: FrameProfile, channels: Sequence[int], settings: BridgeSettings
    ) -> None:
        self.name = name
        self.mode = BoardMode.DISCONNECTED
        self.fault = ''
        self.problem = _ADVICE
        self.good_frames = self.bad_frames = self.slow_exchanges = 0
        self.echo = CommandEcho(
            name, settings, profile.command.has('index') and profile.sensor.has('index')
        )
        self._profile = profile
        self._channels = tuple(channels)
        self._settings = settings
        self._good_in_row = self._bad_in_row = self._slow_in_row = 0
        self._frozen_in_row = 0
        self._fresh_time = -inf
        self._timestamp = -1.0
        self._index: int | None = None
        self._enabled_since: float | None = None

    def watch(self, channels: Sequence[int]) -> None:
        """Expect these motors, 0 and 1, to be driven where the system is enabled."""
        self._channels = tuple(channels)

    def sent(self, index: int) -> None:
        """Note the index of the command that has just been sent."""
        self._index = index

    def slow(self, duration: float) -> None:
        """Judge the duration of an exchange [s]."""
        if duration <= self._settings.exchange_time_max:
            self._slow_in_row = 0
            return
        self.slow_exchanges += 1
        self._slow_in_row += 1
        if self._slow_in_row >= self._settings.slow_exchanges_max:
            self.fail(
                f'exchanges take {1000.0 * duration:.2f} ms, above the limit of '
                f'{1000.0 * self._settings.exchange_time_max:.2f} ms: check clock_hz, and '
                'polling_limit_us of the SPI driver'
            )

    def missed(self, enable: bool = False, problem: str = '') -> None:
        """Take note of a bad frame or of none.

        Parameters
        ----------
        enable
            Whether the commands sent enable the board.
        problem
            What the bus says about it.
        """
        self.echo.missed()
        self.bad_frames += 1
        self._bad_in_row += 1
        self._good_in_row = 0
        self.problem = problem or _ADVICE
        if not self.is_silent:
            return
        if self.mode in (BoardMode.DISCONNECTED, BoardMode.IDLE) and not enable:
            self.mode = BoardMode.DISCONNECTED
        else:
            why = problem or f'no frame with a correct check: {self.problem}'
            self.fail(f'{self._bad_in_row} consecutive frames were bad, {why}')

    def received(self, state: BoardState, now: float, enable: bool, running: bool) -> None:
        """Take note of a good frame.

        Parameters
        ----------
        state
            What the board reports.
        now
            Time of the exchange [s].
        enable
            Whether the commands sent enable the board.
        running
            Whether the commands sent follow a controller.
        """
        self.good_frames += 1
        self._good_in_row += 1
        self._bad_in_row = 0
        if self._index is not None:
            self.echo.answered(state.index, self._index)
        self._frozen_in_row += 1
        if state.timestamp != self._timestamp:
            self._timestamp, self._fresh_time = state.timestamp, now
            self._frozen_in_row = 0
        if self.mode is BoardMode.DISCONNECTED:
            if self._good_in_row < self._settings.connect_frames:
                return
            self.mode = BoardMode.IDLE
        if state.error:
            self.fail(self._profile.error_text(state.error))
        elif enable and self.echo.is_cut:
            self.fail(self.echo.fault)
        elif self._is_frozen(now):
            self.fail('frames are correct but their data is frozen: power-cycle the board')
        if self.mode is not BoardMode.FAULT:
            self._follow(state, now, enable, running)

    def fail(self, text: str) -> None:
        """Enter the fault state; the first fault stays."""
        if self.mode is not BoardMode.FAULT:
            self.mode = BoardMode.FAULT
            self.fault = f'{self.name}: {text}'

    def counters(self) -> dict[str, int]:
        """Return the counts by name."""
        return {
            'good frames': self.good_frames,
            'bad frames': self.bad_frames,
            'lost commands': self.echo.lost,
            'slow exchanges': self.slow_exchanges,
        }

    def clear(self, state: BoardState) -> str:
        """Leave the fault state; return why it cannot be left, or ''."""
        if self.mode is not BoardMode.FAULT:
            return ''
        silent = self.is_silent
        if not silent and state.error:
            return f'{self.name}: {self._profile.error_text(state.error)}'
        if not silent and self.echo.is_cut:
            return self.echo.warning
        if self._slow_in_row >= self._settings.slow_exchanges_max:
            return self.fault
        self.fault = ''
        self._enabled_since = None
        self.mode = BoardMode.DISCONNECTED if silent else BoardMode.IDLE
        return ''

    @property
    def is_silent(self) -> bool:
        """Whether too many exchanges in a row have failed, or no answer was ever good."""
        return self._bad_in_row >= self._settings.bad_frames_max or self.good_frames == 0

    def is_aligned(self, state: BoardState) -> bool:
        """Whether every motor in use is driven and aligned."""
        if not state.system_enabled:
            return False
        enabled, ready = state.motor_enabled, state.motor_ready
        return False not in [enabled[channel] and ready[channel] for channel in self._channels]

    def _is_frozen(self, now: float) -> bool:
        """Whether one answer after the other brought the same data, for too long."""
        looks = self._frozen_in_row >= self._settings.bad_frames_max
        return looks and now - self._fresh_time > self._settings.state_age_max

    def _follow(self, state: BoardState, now: float, enable: bool, running: bool) -> None:
        if not enable:
            self.mode = BoardMode.IDLE
            self._enabled_since = None
        elif self.is_aligned(state):
            self.mode = BoardMode.RUNNING if running else BoardMode.READY
        elif self.mode in (BoardMode.READY, BoardMode.RUNNING):
            self.fail(
                'the board no longer drives its motors: check its supply, because it may '
                'have restarted'
            )
        else:
            self.mode = BoardMode.ALIGNING
            self._enabled_since = now if self._enabled_since is None else self._enabled_since
            if now - self._enabled_since > self._settings.alignment_timeout:
                self.fail(
                    'the motors of the board are not aligned after '
                    f'{self._settings.alignment_timeout:g} s: support the arm, check the motor '
                    'cables, and enable again'
                )
