"""One board as the bridge drives it: frames out, frames in, state followed."""

from collections.abc import Sequence

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.board_monitor import BoardMonitor
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.board_command import BoardCommand
from aerarm_ros.hardware.frames.board_state import BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec, FrameError
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.transports.transport import Transport


class BoardLink:
    """Exchanges one frame a cycle with a board.

    Parameters
    ----------
    number, name
        The board in the transport, and in texts.
    joints
        Pairs of joint number and channel (0 or 1) of the motors in use.
    current_saturation
        Largest currents [A] of channel 0 and 1; 0 for a channel not in use.
    profile, settings, transport
        Layout of the frames, tolerances, and the way to the board.

    Raises
    ------
    ValueError
        If no frame can hold the time-out or a saturation.

    Attributes
    ----------
    monitor
        The board's state machine.
    state
        The last good state.
    fresh
        Whether `state` is of the last exchange.
    """

    def __init__(
        self,
        number: int,
        name: str,
        joints: Sequence[tuple[int, int]],
        current_saturation: Sequence[float],
        profile: FrameProfile,
        settings: BridgeSettings,
        transport: Transport,
    ) -> None:
        self.joints = tuple(joints)
        self.monitor = BoardMonitor(name, profile, [channel for _, channel in joints], settings)
        self.state = BoardState()
        self.fresh = False
        self._number = number
        self._transport = transport
        self._codec = FrameCodec(profile)
        used = {channel for _, channel in joints}
        self._used = [channel in used for channel in (0, 1)]
        # A channel without a motor is never enabled; its saturation only may not be 0.
        saturation = [value or 1.0 for value in current_saturation]
        self._command = BoardCommand(timeout=settings.board_timeout, current_saturation=saturation)
        # What no frame can hold shows now, not when the board is to be switched off.
        try:
            self._codec.encode(self._switched_off())
        except FrameError as error:
            raise ValueError(f'{name} cannot be told its limits: {error}') from None

    @property
    def is_aligned(self) -> bool:
        """Whether every motor in use was driven and aligned when the board last answered."""
        return self.monitor.is_aligned(self.state)

    def may_be_damped(self, now: float) -> bool:
        """Whether the board, after a fault of its own or of others, can still damp the arm.

        If not it is told to switch off: a board that restarted must not align by itself.
        """
        return self.is_aligned and not self.state.error and not self.monitor.is_silent(now)

    def exchange(
        self, references: MotorReferences, now: float, enable: bool, running: bool
    ) -> None:
        """Send the references of the board's motors and take what it reports.

        With `enable` False the board is told to switch off. References that no frame can
        hold are a fault; the board is then told to switch off as well.
        """
        command = self._command
        command.index = (command.index + 1) & 0xFFFF
        command.enable_system = enable
        command.enable_motor = self._used if enable else [False, False]
        for joint, channel in self.joints:
            motor = references.motors[joint]
            command.position[channel] = motor.position
            command.velocity[channel] = motor.velocity
            command.current[channel] = motor.current
            command.kp[channel] = motor.kp
            command.kd[channel] = motor.kd
            command.integral_gain[channel] = motor.integral_gain
        try:
            frame = self._codec.encode(command)
        except FrameError as error:
            self.monitor.fail(str(error))
            frame = self._codec.encode(self._switched_off())
        answer = self._transport.exchange(self._number, frame)
        self._receive(answer, now, enable, running)
        self.monitor.sent(command.index)

    def switch_off(self) -> None:
        """Send zero current and system disabled, once."""
        self._command.index = (self._command.index + 1) & 0xFFFF
        self._transport.exchange(self._number, self._codec.encode(self._switched_off()))

    def _receive(self, answer: bytes, now: float, enable: bool, running: bool) -> None:
        self.monitor.slow(self._transport.exchange_time(self._number))
        self.fresh = self._codec.decode(answer, self.state) is not None
        if self.fresh:
            self.monitor.received(self.state, now, enable, running)
        else:
            self.monitor.missed(now, self._transport.problem(self._number))

    def _switched_off(self) -> BoardCommand:
        return BoardCommand(
            timeout=self._command.timeout,
            current_saturation=self._command.current_saturation,
            index=self._command.index,
        )


def make_links(
    config: ArmConfig, profile: FrameProfile, settings: BridgeSettings, transport: Transport
) -> tuple[BoardLink, ...]:
    """Return a link to each of the arm's boards, with the joints and currents of its motors."""
    links = []
    for number, board in enumerate(config.boards):
        saturation = [0.0, 0.0]
        joints = []
        for index, joint in enumerate(config.joints):
            if joint.board == number:
                joints.append((index, joint.channel))
                by_effort = joint.effort_max / joint.torque_per_ampere
                saturation[joint.channel] = min(by_effort, joint.motor.current_max)
        links.append(
            BoardLink(number, board.name, joints, saturation, profile, settings, transport)
        )
    return tuple(links)
