"""A bridge on emulated boards, with time controlled by the test."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest
from aerarm_ros.hardware.frames.frame_profile import FrameProfile, load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import OfferedCommand

QUICK = AlignmentTiming(forward=0.25, reverse=0.25, hold=0.1)
PERIOD = 1e-3

Reference = Callable[[float], tuple[Sequence[float] | None, ...]]


class Rig:
    """Emulated boards and a bridge, run cycle by cycle.

    `homed`: the zeros are known at the start, as after homing; otherwise the boards are just
    switched on.
    """

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot,
        *,
        seed: int | None = None,
        settings: BridgeSettings | None = None,
        homed: bool = True,
        commissioned: Sequence[float] | float = 0.0,
        **emulation: object,
    ) -> None:
        self.config = config
        self.robot = robot
        if homed:
            emulation.setdefault('encoder_zeros', [0.0] * config.n)
        self.boards = make_emulated_transport(
            config,
            robot,
            seed,
            alignment=QUICK,
            **emulation,  # type: ignore[arg-type]
        )
        self.bridge = BridgeCycle(
            config, self.boards, settings, robot=robot, pulse_offset=commissioned
        )
        if homed:
            self.bridge.zeros.found()
        self.now = 100.0

    @property
    def plant(self):
        return self.boards.plant

    def cycle(self) -> None:
        self.now += PERIOD
        self.bridge.update(self.now)

    def run(self, seconds: float, reference: Reference | None = None) -> np.ndarray:
        """Run with position, velocity, effort = reference(time); return q of each cycle."""
        history = []
        for _ in range(round(seconds / PERIOD)):
            if reference is not None:
                self.send(*reference(self.now))
            self.cycle()
            history.append(self.bridge.q.copy())
        return np.array(history)

    def run_until(self, mode: str, longest: float, reference: Reference | None = None) -> None:
        """Run until the bridge has a mode, for at most `longest` [s]."""
        for _ in range(round(longest / PERIOD)):
            if self.bridge.mode == mode:
                return
            self.run(PERIOD, reference)

    def send(self, position=None, velocity=None, effort=None, source='test', age=PERIOD) -> bool:
        names = self.config.joint_names
        offered = OfferedCommand(names, position, velocity, effort, age, source)
        return self.bridge.command(offered, self.now)

    def enable(self) -> None:
        """Enable the arm; its motors align, which takes 0.6 s."""
        self.run(0.02)
        answer = self.bridge.enable()
        assert answer.accepted, answer.message

    def bring_up(self, aligned: bool = True) -> 'Rig':
        """Enable the arm and let it carry its own weight at rest.

        Unless a test covers the alignment, the motors are declared aligned.
        """
        self.enable()
        if aligned:
            self.align()
            self.run(0.02)
            self.plant.support = 0.0
            self.run(0.15)
        else:
            self.run(1.3)
        assert self.bridge.mode == 'ready', self.bridge.faults
        assert self.plant.support == 0.0
        return self

    def align(self) -> None:
        """Declare every motor aligned."""
        for board in self.boards.boards:
            for motor in board.motors:
                motor.ready = True

    def inject(self, fault: str, board: int = 0, motor: int = 0, value: float | None = None):
        FaultRequest(fault, board, motor, value).apply(self.boards)

    @property
    def speed(self) -> float:
        """Largest true joint speed [rad/s]."""
        return float(np.abs(self.plant.velocity).max())


@pytest.fixture(scope='session')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def robot() -> Robot:
    return load_robot()


@pytest.fixture
def make_rig(config: ArmConfig, robot: Robot) -> Callable[..., Rig]:
    def make(**options: object) -> Rig:
        return Rig(options.pop('config', config), robot, **options)

    return make


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    """An arm as drawn, ready at its home configuration."""
    return make_rig().bring_up()


@pytest.fixture
def coarse_profile() -> Callable[[str, float], FrameProfile]:
    """Return a function that returns the default profile with another scale of a command field."""

    def make(name: str, lsb: float) -> FrameProfile:
        profile = load_profile()
        fields = [replace(f, lsb=lsb) if f.name == name else f for f in profile.command.fields]
        return replace(profile, command=replace(profile.command, fields=tuple(fields)))

    return make
