"""Emulated boards on a simulated arm, in step with the caller's time."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, Array

_CATCH_UP = 0.010  # [s] most that one call simulates
_RELEASE_TIME = 0.5  # [s] in which whoever carries the arm lets it go


class EmulatedTransport:
    """A `Transport` whose boards drive an `ArmPlant`.

    `advance(now)` runs boards and arm in whole sub-steps up to `now`. After a gap of more
    than 10 ms simulated time slips by the rest, so that a host that was late neither bursts
    to catch up nor lets the boards' time-outs strike for it. It may run ahead of the next
    exchange, as real boards do beside the host: `advance` to an earlier time then does nothing.

    A real arm is carried by hand until its motors hold it, because the alignment of
    unpowered motors cannot lift it. So is this one: its weight is carried at first, and let
    go within 0.5 s once every motor is ready. `carry` takes it up again where it is,
    `put_back` where it started, `put_at_rest` in its rest posture.

    Parameters
    ----------
    boards
        One for each of the configuration's boards.
    plant
        The arm.
    config
        Connects joints to boards, and gives signs, offsets and gear ratios.
    """

    def __init__(self, boards: Sequence[EmulatedBoard], plant: ArmPlant, config: ArmConfig) -> None:
        self.boards = tuple(boards)
        self.plant = plant
        self.slipped = 0.0
        ratios = config.column('sign') / config.column('gear.ratio')
        motors = [self.boards[joint.board].motors[joint.channel] for joint in config.joints]
        self._angles = [[0.0, 0.0] for _ in self.boards]
        # What each joint turns: where its motor's angle goes, the motor, its gear and its zero.
        self._drives = [
            (self._angles[joint.board], joint.channel, motor, ratio, joint.offset)
            for joint, motor, ratio in zip(config.joints, motors, ratios.tolist(), strict=True)
        ]
        efficiency = config.column('gear.efficiency')
        torque_constant = plant.parameters.motor_torque_constant
        self._effort_per_current = (torque_constant * efficiency * ratios).tolist()
        self._start = plant.position
        self._rest: Array = np.array(config.rest_position)
        self._now: float | None = None
        self.carry()

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Pass a frame to an emulated board and return its answer."""
        return self.boards[board].exchange(frame)

    def exchange_time(self, board: int) -> float:
        """Duration that the emulated bus claims for an exchange [s]."""
        return self.boards[board].faults.exchange_time

    def exchanged_at(self, board: int) -> float:
        """When the last exchange with a board was [s]: the time to which the boards have run."""
        return self._now or 0.0

    def problem(self, board: int) -> str:
        """Emulated wires never break: the boards' faults are seen in the frames."""
        return ''

    @property
    def is_carried(self) -> bool:
        """Whether the arm's weight is carried by hand."""
        return self._carried

    def carry(self) -> None:
        """Stop the arm by hand and carry its weight until every motor is ready."""
        self.plant.reset(self.plant.position)
        self._carried = True
        self.plant.support = 1.0
        for _, _, motor, _, _ in self._drives:
            motor.encoder.velocity = 0.0
        for board in self.boards:
            board.prepare()  # the frame made before tells of a moving arm

    def put_back(self) -> None:
        """Take the arm back to where it started, and carry it: what to do before enabling again."""
        self._put(self._start)

    def put_at_rest(self) -> None:
        """Take the arm to its rest posture, and carry it: what to do before homing."""
        self._put(self._rest)

    def _put(self, target: Array) -> None:
        self.plant.restart(target)
        positions = target.tolist()
        for (_, _, motor, ratio, offset), q in zip(self._drives, positions, strict=True):
            motor.encoder.place((q - offset) * ratio)
        self.carry()

    def advance(self, now: float) -> None:
        """Run boards and arm up to `now` [s], or 10 ms at most."""
        if self._now is None or now < self._now - _CATCH_UP:
            self._now = now
        late = now - self._now - _CATCH_UP
        if late > 0.0:
            self.slipped += late
            self._now += late
        steps = max(0, int((now - self._now) / SUBSTEP + 1e-6))
        self._now += steps * SUBSTEP
        if steps and self.plant.support > 0.0:
            self._let_go(steps * SUBSTEP)
        for _ in range(steps):
            self._step()
        if steps:
            for board in self.boards:
                board.prepare()

    def _step(self) -> None:
        drives = self._drives
        positions = self.plant.position.tolist()
        for (angles, channel, _, ratio, offset), q in zip(drives, positions, strict=True):
            angles[channel] = (q - offset) * ratio
        for board, (first, second) in zip(self.boards, self._angles, strict=True):
            board.step(first, second)
        gains = self._effort_per_current
        self.plant.apply_effort(
            [gain * drive[2].torque_current for gain, drive in zip(gains, drives, strict=True)]
        )
        self.plant.step()

    def _let_go(self, duration: float) -> None:
        if self._carried:
            motors = [motor for _, _, motor, _, _ in self._drives]
            self._carried = not all(motor.ready and motor.enabled for motor in motors)
        else:
            self.plant.support -= duration / _RELEASE_TIME
