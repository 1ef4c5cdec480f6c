"""The emulated arm in simulation time: bridge, frames, boards and physics engine, without ROS.

The simulation does not wait, so the results do not depend on the machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.player import ExcitationPlayer, VelocityLaw
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.excitation.trajectory import MotionSequence
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.simulation.arm_plant import PlantParameters

CYCLE = 1e-3


@dataclass(frozen=True)
class State:
    """Content of joint_states, motor_states and motor_power, and time along the motion [s]."""

    stamp_ns: int
    path_time: float
    q: np.ndarray
    dq: np.ndarray
    tau: np.ndarray
    current: np.ndarray
    speed: np.ndarray
    power: np.ndarray


class EmulatedArm:
    """An arm with the parameters `truth`, enabled and holding its posture."""

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot,
        truth: PlantParameters,
        posture: np.ndarray,
        seed: int | None = None,
    ) -> None:
        config = config.with_encoders('absolute')
        self._names = config.joint_names
        self._stops = StopLimits(MotionLimits.of_arm(config), None)
        transport = make_emulated_transport(config, robot, seed, position=posture, parameters=truth)
        self._bridge = BridgeCycle(config, transport, BridgeSettings(stall_time=60.0), robot=robot)
        self.plant = transport.plant
        transport.open()
        self._now = 0.0
        while self._bridge.mode != 'ready':
            self._bridge.update(self._now)
            if self._bridge.mode == 'idle':
                self._bridge.enable()
            self._now += CYCLE
            assert self._now < 20.0, self._bridge.faults

    @property
    def posture(self) -> np.ndarray:
        return self._bridge.q.copy()

    def play(self, motion: MotionSequence) -> Iterator[State]:
        """Play a motion in velocity mode; yield every state."""
        bridge = self._bridge
        player = ExcitationPlayer(motion, VelocityLaw(1.0), self._stops)
        while not player.done:
            stamp = 1_700_000_000_000_000_000 + round(self._now * 1e9)
            command = player.update(stamp, bridge.q.copy())
            told = (bridge.q, bridge.dq, bridge.tau)
            motors = (bridge.motor_current, bridge.motor_velocity, bridge.motor_power)
            yield State(stamp, player.path_time, *(v.copy() for v in (*told, *motors)))
            self._now += CYCLE
            bridge.command(OfferedCommand(self._names, *command, CYCLE, 'test'), self._now)
            bridge.update(self._now)
            assert bridge.mode == 'running', bridge.faults
        assert player.fault is None
