"""A bridge under attack: emulated boards, the true arm, and a host of the attacker's choice.

All times are virtual and exact: an attack gives equal figures on any machine. The test covers the
whole `BridgeCycle`, from commands to frames; the plant is MuJoCo.

    rig = AttackRig(config, robot, posture=[0, 1.2, 0, 0], payload=0.2, seed=3)
    log = rig.run(2.0, lambda rig: Offer(velocity=[0, 5, 0, 0]))
    log.beyond(config).max()    # [rad] how far the true arm was beyond its position limits
    log.time, log.q, log.dq     # true time and joints, every millisecond and when time was read
    log.modes, log.faults       # modes of the bridge, one per cycle, and its faults
    rig.frames.commands(0)      # every frame to board 0, decoded without the suite's codec

- Posture, seed (of the arm's deviations from its drawing), payload: arguments of the rig. Base:
  `gravity`, its direction in the base frame.
- Command source: a function of the rig that returns an `Offer`, or None for silence. It is called
  once per cycle with the bridge's newest state; its result acts in the next update, as over
  topics.
- Host: a function `delays(cycle, point)` in seconds, see `attack_world`. It delays the host at
  WAKE, READ, or before (EXCHANGE) and after (ANSWER) a frame. Missed cycles are skipped, as in the
  real loop, but the arm is still checked. None is a perfect 1 kHz.
- Boards: `rig.world.boards`, an `EmulatedTransport`; faults with `inject`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import NamedTuple

import numpy as np
from attack_world import WAKE, AttackWorld, Delays

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.simulation.arm_plant import PlantParameters

PERIOD = 1e-3  # [s], of the default settings
PAYLOAD_CENTRE = (0.1, 0.0, 0.0)  # [m] tool0
_PAYLOAD_RADIUS = 0.03  # [m]
_QUICK = AlignmentTiming(forward=0.25, reverse=0.25, hold=0.1)


class Offer(NamedTuple):
    """A joint command, (n,) each, None or NaN where unused, and its sender."""

    position: Sequence[float] | np.ndarray | None = None
    velocity: Sequence[float] | np.ndarray | None = None
    effort: Sequence[float] | np.ndarray | None = None
    source: object = 'attacker'
    age: float = PERIOD


Source = Callable[['AttackRig'], Offer | None]


@dataclass
class AttackLog:
    """Log of a run: the true arm each millisecond, the bridge's mode each cycle, its stops.

    Attributes
    ----------
    time, q_rows, dq_rows
        Rows of `q` and `dq` with their true times [s].
    driven_rows
        Number of rows before a board first switched its motors off.
    modes
        The bridge's mode after each cycle.
    faults
        Every stop, and every fault of a board, once.
    accepted
        Number of accepted commands.
    """

    time: list[float] = field(default_factory=list)
    q_rows: list[np.ndarray] = field(default_factory=list)
    dq_rows: list[np.ndarray] = field(default_factory=list)
    modes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    accepted: int = 0
    driven_rows: int | None = None

    @property
    def q(self) -> np.ndarray:
        """True joint angles [rad], (M, n)."""
        return np.array(self.q_rows)

    @property
    def dq(self) -> np.ndarray:
        """True joint velocities [rad/s], (M, n)."""
        return np.array(self.dq_rows)

    def beyond(self, config: ArmConfig) -> np.ndarray:
        """Return the largest distance of each joint beyond its position limits [rad], (n,)."""
        above = self.q - config.column('position_max')
        below = config.column('position_min') - self.q
        return np.maximum(above, below).max(axis=0)

    def speed_ratio(self, config: ArmConfig) -> np.ndarray:
        """Return the largest speed of each joint as a multiple of its limit, (n,)."""
        return np.abs(self.dq).max(axis=0) / config.column('velocity_max')

    def driven(self) -> 'AttackLog':
        """Return the run until a board switched its motors off, after which no limit applies."""
        rows = self.driven_rows
        return replace(
            self, time=self.time[:rows], q_rows=self.q_rows[:rows], dq_rows=self.dq_rows[:rows]
        )


class AttackRig:
    """Emulated boards, a true arm, a bridge and its host; see the module.

    Parameters
    ----------
    config, robot
        The arm as drawn.
    posture
        Joint angles (n,) at the start [rad]; by default the home configuration.
    payload
        Mass at the tool [kg], unknown to the bridge.
    seed
        Seed of the arm's deviations from its drawing; None for an arm as drawn.
    settings, gains
        Settings of the bridge, including the host's period; gains are (kp, kd) or (kp, kd,
        integral_gain), motor side.
    delays
        Delays of the host, None for a host without delays.
    gravity
        (3,) in the base frame [m/s^2], unknown to the bridge.
    homed
        Whether the zeros are known at the start, as after homing; otherwise the boards are just
        switched on.
    """

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot,
        *,
        posture: Sequence[float] | None = None,
        payload: float = 0.0,
        seed: int | None = None,
        settings: BridgeSettings | None = None,
        gains: Sequence[Sequence[float]] | None = None,
        delays: Delays | None = None,
        gravity: Sequence[float] | None = None,
        homed: bool = True,
    ) -> None:
        self.config = config
        truth = PlantParameters.nominal(config, robot)
        if seed is not None:
            truth = truth.perturbed(seed)
        truth = replace(truth.carrying(payload, PAYLOAD_CENTRE, _PAYLOAD_RADIUS), seed=seed)
        self.boards = make_emulated_transport(
            config,
            robot,
            seed,
            position=posture,
            parameters=truth,
            alignment=_QUICK,
            encoder_zeros=[0.0] * config.n if homed else None,
        )
        if gravity is not None:
            self.plant.gravity_in_base = gravity
        self.log = AttackLog()
        self._script = delays
        self._period = (settings or BridgeSettings()).period
        self.world = AttackWorld(self.boards, self._look)
        self.bridge = BridgeCycle(config, self.world, settings, robot=robot)
        if homed:
            self.bridge.zeros.found()
        if gains is not None:
            self.bridge.references.set_gains(*gains)
        self.cycles = 0

    @property
    def plant(self):
        """The true arm."""
        return self.boards.plant

    @property
    def frames(self):
        """Every frame of the run, a `FrameLog`."""
        return self.world.frames

    @property
    def now(self) -> float:
        """True time [s], which is the host's clock."""
        return self.world.now

    def bring_up(self) -> 'AttackRig':
        """Enable the arm, declare its motors aligned, and let it carry its weight.

        The host's delays begin afterwards, with cycle 0.
        """
        self.run(0.02)
        answer = self.bridge.enable()
        assert answer.accepted, answer.message
        for board in self.boards.boards:
            for motor in board.motors:
                motor.ready = True
        self.run(0.02)
        self.plant.support = 0.0
        self.run(0.1)
        assert self.bridge.mode == 'ready', self.bridge.faults
        self.cycles, self.log = 0, AttackLog()
        self.world.script(self._script)
        return self

    def run(self, seconds: float, source: Source | None = None) -> AttackLog:
        """Run for a true time [s]; return the log since `bring_up`, which continues to grow."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.cycle(source)
        return self.log

    def cycle(self, source: Source | None = None) -> None:
        """Run one cycle of the host."""
        world, bridge, log = self.world, self.bridge, self.log
        due = self._period * ceil(world.now / self._period + 1e-6)
        offer = source(self) if source is not None else None
        world.pass_time(due)
        world.cycle = self.cycles
        world.hold_up(WAKE)
        if offer is not None:
            offered = OfferedCommand(self.config.joint_names, *offer[:3], offer.age, offer.source)
            log.accepted += bridge.command(offered, world.clock())
        bridge.update(world.clock())
        self.cycles += 1
        log.modes.append(bridge.mode)
        if bridge.gate.stop and bridge.gate.stop not in log.faults:
            log.faults.append(bridge.gate.stop)
        monitors = [link.monitor.fault for link in bridge.links]
        log.faults += [fault for fault in monitors if fault and fault not in log.faults]

    def _look(self, now: float) -> None:
        self.log.time.append(now)
        self.log.q_rows.append(self.plant.position)
        self.log.dq_rows.append(self.plant.velocity)
        if self.log.driven_rows is None and any(b.is_torque_free for b in self.boards.boards):
            self.log.driven_rows = len(self.log.time) - 1

    def inject(
        self, fault: str, board: int = 0, motor: int = 0, value: float | None = None
    ) -> None:
        """Inject a fault into a board or motor."""
        FaultRequest(fault, board, motor, value).apply(self.boards)
