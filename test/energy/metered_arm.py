"""The emulated arm in simulation time, with an energy meter at every motor and gear."""

from dataclasses import dataclass, field

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.experiment.experiment_bench import MotionSource
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.motion.signals import ArmState, JointMotion
from aerarm_ros.simulation.arm_plant import SUBSTEP, PlantParameters

CYCLE = 1e-3


@dataclass
class Meter:
    """True energies of the simulated motors and gears [J], (4,) each, and the arm's energy."""

    copper: np.ndarray = field(default_factory=lambda: np.zeros(4))
    shaft: np.ndarray = field(default_factory=lambda: np.zeros(4))
    friction: np.ndarray = field(default_factory=lambda: np.zeros(4))
    supplied: np.ndarray = field(default_factory=lambda: np.zeros(4))
    stored: float = 0.0
    told: np.ndarray = field(default_factory=lambda: np.zeros(4))  # from motor_power


class MeteredArm:
    """An arm as drawn, which follows motions by computed torque with the exact model."""

    def __init__(self, config: ArmConfig, robot: Robot, posture: np.ndarray) -> None:
        config = config.with_encoders('absolute')
        self._names = config.joint_names
        truth = PlantParameters.nominal(config, robot)
        self._boards = make_emulated_transport(
            config, robot, None, position=posture, parameters=truth
        )
        self._plant = self._boards.plant
        motors = [self._boards.boards[j.board].motors[j.channel] for j in config.joints]
        self._motors = motors
        self._resistance = 1.5 * config.column('motor.resistance')
        self._inertia = truth.rotor_inertia
        self._per_ampere = config.column('torque_per_ampere') * config.column('sign')
        self._meter: Meter | None = None
        self._step, self._plant.step = self._plant.step, self._metered_step
        self._bridge = BridgeCycle(config, self._boards, robot=robot)
        self._boards.open()
        self._now = 0.0
        self._enable()
        friction = FrictionCompensation(
            robot.viscous, robot.coulomb, load_share=truth.load_friction
        )
        law = ComputedTorque(
            MovingBaseDynamics(robot, truth.rotor_inertia), 400.0, 40.0, friction=friction
        )
        self._limits, self._law = JointLimits.from_config(config), law

    def play(self, motion: JointMotion, settle: float = 0.05) -> tuple[Meter, list]:
        """Play a motion; return the meter and the bridge's states, with times."""
        source = MotionSource(motion)  # type: ignore[arg-type]
        loop = ControlLoop(self._limits, source, self._law)
        states, bridge = [], self._bridge
        for _ in range(round(settle / CYCLE)):
            self._cycle(loop)
        source.begin = self._now
        self._meter = Meter(stored=-self._plant.energy)
        states.append((self._now, self._state()))
        for _ in range(round(motion.duration / CYCLE)):
            self._cycle(loop)
            states.append((self._now, self._state()))
            self._meter.told += CYCLE * np.maximum(bridge.motor_power, 0.0)
        self._meter.stored += self._plant.energy
        meter, self._meter = self._meter, None
        assert bridge.mode == 'running', bridge.faults
        return meter, states

    def _state(self) -> ArmState:
        bridge = self._bridge
        return ArmState(bridge.q.copy(), bridge.dq.copy(), bridge.tau.copy())

    def _cycle(self, loop: ControlLoop) -> None:
        command = loop.update(self._state(), self._now)
        self._now += CYCLE
        if command is not None:
            offered = OfferedCommand(self._names, *command, CYCLE, 'test')
            self._bridge.command(offered, self._now)
        self._bridge.update(self._now)

    def _enable(self) -> None:
        bridge = self._bridge
        while bridge.mode != 'ready' or self._plant.support > 0.0:
            bridge.update(self._now)
            if bridge.mode == 'idle':
                bridge.enable()
            for motor in self._motors:
                motor.ready = True
            self._now += CYCLE
            assert self._now < 5.0, bridge.faults

    def _metered_step(self) -> None:
        plant, meter = self._plant, self._meter
        if meter is None:
            self._step()
            return
        current = np.array([motor.torque_current for motor in self._motors])
        effort = self._per_ampere * current
        before = plant.velocity
        self._step()
        dq = 0.5 * (before + plant.velocity)
        copper, shaft = self._resistance * current**2, effort * dq
        friction = effort - self._inertia * plant.acceleration - plant.transmitted_effort
        meter.copper += SUBSTEP * copper
        meter.shaft += SUBSTEP * shaft
        meter.friction += SUBSTEP * friction * dq
        meter.supplied += SUBSTEP * np.maximum(copper + shaft, 0.0)
