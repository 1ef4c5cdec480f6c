"""State machine of a motor board, and counter of commands that did not reach the board."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from math import inf

from aerarm_ros.description.arm_config import PowerStageConfig
from aerarm_ros.hardware.frames.board_messages import BoardState
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings


class BoardMode(StrEnum):
    """Mode of a board: disconnected to running, or fault, which lasts until it is cleared."""

    DISCONNECTED = 'disconnected'
    IDLE = 'idle'
    ALIGNING = 'aligning'
    READY = 'ready'
    RUNNING = 'running'
    FAULT = 'fault'


# Constants, because Python 3.11 is slow to look up members of an enumeration.
_DISCONNECTED, _IDLE, _ALIGNING, _READY, _RUNNING, _FAULT = BoardMode

_INDICES = 0x10000
_MEMORY = 1000  # number of commands over which the loss rate is averaged
# A higher rate means a loss in the last few thousand commands; a single loss gives 1/1000.
_RECENT_RATE = 1e-4
_CHECK = 'check the MOSI wire, its connector, the ground wire and clock_hz'


class CommandEcho:
    """Counts commands that did not reach a board, although the board's answers reach the host.

    A board answers before it reads the command of the same exchange, so an answer echoes the
    previous command. A command is counted as lost only if its own exchange and the next exchange
    brought valid answers. If the answer is lost as well, the exchange counts as a bad frame.

    Parameters
    ----------
    name
        Name of the board in messages.
    settings
        Tolerances; this class uses `lost_commands_max` and `lost_commands_warning`.
    echoes
        False if the board's frames carry no command index; then no command counts as lost.

    Attributes
    ----------
    lost
        Number of commands lost since the start.
    lost_in_row
        Number of consecutive commands lost since a command last arrived.
    rate
        Fraction of lost commands, averaged over about the last 1000 commands.
    unconfirmed
        Number of commands sent after the command that the board had used at its last answer; 1
        without losses.
    """

    def __init__(self, name: str, settings: BridgeSettings, echoes: bool = True) -> None:
        self.lost = self.lost_in_row = 0
        self.rate = 0.0
        self.unconfirmed = 1
        self._name = name
        self._settings = settings
        self._echoes = echoes
        self._answered = False  # whether the previous exchange brought a valid answer

    @property
    def is_losing(self) -> bool:
        """Whether a command to the board was lost in the last few seconds."""
        return self.rate > _RECENT_RATE

    @property
    def is_cut(self) -> bool:
        """Whether so many consecutive commands were lost that the command wire counts as cut."""
        return self.lost_in_row >= self._settings.lost_commands_max

    @property
    def fault(self) -> str:
        """Text of the fault of a cut command wire; the caller adds the name of the board."""
        return (
            f'{self.lost_in_row} consecutive commands did not reach the board over MOSI, '
            f'although its answers reach the host: {_CHECK}'
        )

    @property
    def warning(self) -> str:
        """Warning about the command wire if too many commands are lost; otherwise ''."""
        if self.is_cut:
            return f'{self._name}: {self.fault}'
        if self.rate <= self._settings.lost_commands_warning:
            return ''
        return (
            f'{self._name}: {100.0 * self.rate:.0f} % of the commands do not reach the board '
            f'over MOSI, although its answers reach the host; {_CHECK}'
        )

    def answered(self, echoed: int, sent: int) -> None:
        """Compare the command index that an answer echoes with that of the previous command."""
        if not self._echoes:
            return
        behind = (sent - echoed) % _INDICES
        if self._answered:
            is_lost = behind > 0
            self.lost += is_lost
            self.lost_in_row += 1
            self.rate += (is_lost - self.rate) / _MEMORY
        # A command may have arrived although the answer in its exchange was lost.
        if behind < self.lost_in_row:
            self.lost_in_row = behind
        self.unconfirmed = behind + 1
        self._answered = True

    def missed(self) -> None:
        """Record that the last exchange with the board returned no valid answer."""
        self.unconfirmed += 1
        self._answered = False


_ADVICE = 'check supply, wires and SPI mode'


class BoardMonitor:
    """State machine of a board, driven by the board's answers; a fault lasts until it is cleared.

    A board goes from disconnected to idle once it answers reliably. When the system is enabled,
    the board goes to aligning, and to ready once every motor in use is aligned. A board is running
    while the arm follows a command, and returns to idle when the system is disabled. These
    conditions lead to fault: an error code, too many bad frames, too many lost commands to a
    driven board, data that no longer change, slow exchanges, or motors that are no longer ready.

    A board counts as silent after a number of failed exchanges and not after a time, because the
    host itself may have been delayed.

    Parameters
    ----------
    name
        Name of the board in messages.
    profile
        Frame layout with the meaning of error codes.
    channels
        Channels (0, 1) of the motors in use.
    settings
        Tolerances.

    Attributes
    ----------
    mode
        Present mode of the board.
    fault
        Description of the fault and what to check; '' unless the mode is fault.
    problem
        Description of the last bad frame, or what to check.
    good_frames, bad_frames, slow_exchanges
        Numbers of valid frames, bad frames and slow exchanges since the start.
    echo
        Counter of lost commands.
    """

    def __init__(
        self, name: str, profile: FrameProfile, channels: Sequence[int], settings: BridgeSettings
    ) -> None:
        self.name = name
        self.mode: BoardMode = _DISCONNECTED
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
        """Set the channels (0, 1) of the motors that the board must drive while it is enabled."""
        self._channels = tuple(channels)

    def sent(self, index: int) -> None:
        """Record the index of the command that the bridge has just sent to the board."""
        self._index = index

    def slow(self, duration: float) -> None:
        """Check the duration of an exchange [s]; too many slow exchanges in a row are a fault."""
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
        """Process an exchange without a valid answer of the board.

        Parameters
        ----------
        enable
            Whether the commands sent enable the board.
        problem
            Problem that the transport reports; '' for none.
        """
        self.echo.missed()
        self.bad_frames += 1
        self._bad_in_row += 1
        self._good_in_row = 0
        self.problem = problem or _ADVICE
        if not self.is_silent:
            return
        if self.mode in (_DISCONNECTED, _IDLE) and not enable:
            self.mode = _DISCONNECTED
        else:
            why = problem or f'no frame with a correct check: {self.problem}'
            self.fail(f'{self._bad_in_row} consecutive frames were bad, {why}')

    def received(self, state: BoardState, now: float, enable: bool, running: bool) -> bool:
        """Process a valid answer of the board; return the result of `is_aligned`.

        Parameters
        ----------
        state
            State that the board reports.
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
        is_aligned = self.is_aligned(state)
        if self.mode is _DISCONNECTED:
            if self._good_in_row < self._settings.connect_frames:
                return is_aligned
            self.mode = _IDLE
        if state.error:
            self.fail(self._profile.error_text(state.error))
        elif enable and self.echo.is_cut:
            self.fail(self.echo.fault)
        elif self._frozen_in_row and self._is_frozen(now):
            self.fail('frames are correct but their data is frozen: power-cycle the board')
        if self.mode is not _FAULT:
            self._follow(is_aligned, now, enable, running)
        return is_aligned

    def fail(self, text: str) -> None:
        """Enter the mode fault with a text; keep the text of an earlier fault."""
        if self.mode is not _FAULT:
            self.mode = _FAULT
            self.fault = f'{self.name}: {text}'

    def counters(self) -> dict[str, int]:
        """Return the numbers of good frames, bad frames, lost commands and slow exchanges."""
        return {
            'good frames': self.good_frames,
            'bad frames': self.bad_frames,
            'lost commands': self.echo.lost,
            'slow exchanges': self.slow_exchanges,
        }

    def clear(self, state: BoardState) -> str:
        """Leave the mode fault; return the reason if the fault persists, otherwise ''."""
        if self.mode is not _FAULT:
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
        self.mode = _DISCONNECTED if silent else _IDLE
        return ''

    @property
    def is_connected(self) -> bool:
        """Whether the board has sent enough consecutive valid answers to count as connected."""
        return self.mode is not _DISCONNECTED

    @property
    def is_silent(self) -> bool:
        """Whether the last exchanges failed too often, or no valid answer has arrived yet."""
        return self._bad_in_row >= self._settings.bad_frames_max or self.good_frames == 0

    def is_aligned(self, state: BoardState) -> bool:
        """Whether the board drives every motor in use, and every such motor is aligned."""
        if not state.system_enabled:
            return False
        for channel in self._channels:
            if not (state.motor_enabled[channel] and state.motor_ready[channel]):
                return False
        return True

    def _is_frozen(self, now: float) -> bool:
        """Whether the board's answers have carried the same timestamp for too long."""
        looks = self._frozen_in_row >= self._settings.bad_frames_max
        return looks and now - self._fresh_time > self._settings.state_age_max

    def _follow(self, is_aligned: bool, now: float, enable: bool, running: bool) -> None:
        if not enable:
            self.mode = _IDLE
            self._enabled_since = None
        elif is_aligned:
            self.mode = _RUNNING if running else _READY
        elif self.mode in (_READY, _RUNNING):
            self.fail(
                'the board no longer drives its motors: check its supply, because it may '
                'have restarted'
            )
        else:
            self.mode = _ALIGNING
            self._enabled_since = now if self._enabled_since is None else self._enabled_since
            if now - self._enabled_since > self._settings.alignment_timeout:
                self.fail(
                    'the motors of the board are not aligned after '
                    f'{self._settings.alignment_timeout:g} s: support the arm, check the motor '
                    'cables, and enable again'
                )


# Consecutive readings beyond a limit that rule out noise: 5 ms at 1 kHz with two motors per board.
_IN_ROW = 10  # decision 81
# A warning appears at this fraction inside the limits; it stays for this time [s], to be read.
_WARNING_SHARE = 0.05
_SHOWN = 5.0


class SupplyWatch:
    """Warns of a supply voltage near its limits, and stops the arm beyond the limits.

    The voltage of a supply that cannot absorb braking energy rises with each braking, so a stop
    must end the motion. At a low voltage the boards would switch off and drop the arm, while an
    arm that was stopped and damped before sinks slowly.

    Parameters
    ----------
    name
        Name of the board.
    stage
        Voltage limits of the supply.

    Attributes
    ----------
    voltage
        Last reading [V], 0 before the first.
    """

    def __init__(self, name: str, stage: PowerStageConfig) -> None:
        self.voltage = 0.0
        self._name = name
        self._stage = stage
        self._warn_below = (1.0 + _WARNING_SHARE) * stage.voltage_min
        self._warn_above = (1.0 - _WARNING_SHARE) * stage.voltage_max
        self._low_in_row = self._high_in_row = 0
        self._warning = ''
        self._warned_for = 0.0

    def update(self, voltage: float, duration: float) -> None:
        """Process a supply voltage reading [V], `duration` [s] after the previous reading."""
        self.voltage = voltage
        self._low_in_row = self._low_in_row + 1 if voltage < self._stage.voltage_min else 0
        self._high_in_row = self._high_in_row + 1 if voltage > self._stage.voltage_max else 0
        self._warned_for -= duration
        if voltage > self._warn_above:
            self._warn(f'{voltage:.1f} V, near its maximum of {self._stage.voltage_max:g} V')
        elif voltage < self._warn_below:
            self._warn(f'{voltage:.1f} V, near its minimum of {self._stage.voltage_min:g} V')
        elif self._warned_for <= 0.0:
            self._warning = ''

    def stop(self) -> str:
        """Return the reason if the supply voltage requires a stop of the arm, otherwise ''."""
        if self._high_in_row >= _IN_ROW:
            return (
                f'the supply of {self._name} has {self.voltage:.1f} V, above its limit of '
                f'{self._stage.voltage_max:g} V, because it does not absorb braking energy: use '
                'a battery or a braking resistor, or lower velocity_max'
            )
        if self._low_in_row >= _IN_ROW:
            return (
                f'the supply of {self._name} has {self.voltage:.1f} V, below its limit of '
                f'{self._stage.voltage_min:g} V: support the arm, charge the battery or check '
                'the leads; check the scale in the board profile if the voltage is wrong'
            )
        return ''

    def warning(self) -> str:
        """Return the present warning about the supply voltage, '' without one."""
        return self._warning

    def _warn(self, text: str) -> None:
        self._warning = f'the supply of {self._name} had {text}'
        self._warned_for = _SHOWN
