"""Emulated boards and simulated arm of the node `fake_hardware`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.resources import write_whole
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import OFF, Action, Answer
from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport, parse_turn
from aerarm_ros.hardware.emulation.emulation import (
    make_emulated_transport,
    mount_on_base,
    mount_on_drone,
)
from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FORM, FaultRequest
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.bridge.bridge_diagnostics import Status
from aerarm_ros.ros.bridge.bridge_parameters import BRIDGE_PARAMETERS, TRANSPORT
from aerarm_ros.ros.bridge.commissioning_topics import COMMISSIONING_PARAMETER
from aerarm_ros.ros.bridge.hardware_bridge import Command, World
from aerarm_ros.ros.emulation import drone_parameters
from aerarm_ros.ros.emulation.drone_parameters import CONTACT, DRONE_PARAMETERS
from aerarm_ros.ros.emulation.emulated_sensors import SENSOR_PARAMETERS, EmulatedSensors
from aerarm_ros.ros.emulation.emulated_world import LAG, PACE_PARAMETERS, REAL_TIME, EmulatedWorld
from aerarm_ros.ros.emulation.emulation_parameters import EMULATION_PARAMETERS, plant_parameters
from aerarm_ros.ros.emulation.flying_drone import EmulatedDrone, FlyingDrone
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import load_arm, load_drone
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import BASE_PROFILES, STILL
from aerarm_ros.simulation.flying_plant import FlyingPlant
from aerarm_ros.simulation.made_geometry import MadeGeometry

PARAMETERS = ParameterTable(
    # An emulated arm needs no commissioning.
    *(
        replace(p, default='') if p is COMMISSIONING_PARAMETER else p
        for p in BRIDGE_PARAMETERS
        if p is not TRANSPORT
    ),
    *PACE_PARAMETERS,
    *EMULATION_PARAMETERS,
    *SENSOR_PARAMETERS,
    *DRONE_PARAMETERS,
)

# [s] simulation time in which a fault has an effect, and in which sensors publish a reset pose
_EFFECT_TIME = 1.0
_NO_DRONE = 'the parameters contact_force and wall need a flying drone: set drone_file'
_WALL_LINK = 'tool0'


def _load_arm(values: SimpleNamespace) -> tuple[ArmConfig, Robot]:
    config, robot = load_arm(values)
    return (config.with_encoders(values.encoders) if values.encoders else config), robot


class EmulatedArm(World):
    """Run the bridge on emulated boards and a simulated arm, in simulation time.

    A person supports a real arm until its motors hold it. The service `enable` therefore first
    stops the fall of the emulated arm. If the arm is outside its position limits, `enable` resets
    it to its initial configuration.
    """

    emulated = True
    parameters = PARAMETERS
    boards: EmulatedTransport
    _made: Callable[[Sequence[float]], PlantParameters]

    def __init__(self) -> None:
        super().__init__()
        self._drone: EmulatedDrone | None = None
        self._geometry: MadeGeometry | None = None
        self._sensors: EmulatedSensors | None = None
        self._time: EmulatedWorld | None = None
        self._now = 0.0
        self.live = {
            'fault': self._inject_fault,
            'hand': self._turn,
            'payload': self._grasp,
            **dict.fromkeys(CONTACT, self._touch),
        }

    def load_arm(self) -> tuple[ArmConfig, Robot]:
        """Load configuration and model of the arm, with the encoder type in `encoders`."""
        return _load_arm(self.bridge.values)

    def make_transport(
        self, config: ArmConfig, robot: Robot, profile: FrameProfile
    ) -> EmulatedTransport:
        """Create emulated boards and the simulated arm; write `truth_file` if it is set."""
        values = self.bridge.values
        if len(values.initial_position) not in (0, config.n):
            raise ValueError(
                f'the parameter initial_position has {len(values.initial_position)} values: set '
                f'one value for each of {", ".join(config.joint_names)}'
            )
        drawn = robot
        config, robot = self._as_made(config, robot)
        self._made = partial(plant_parameters, config, robot, values)
        self.boards = transport = make_emulated_transport(
            config,
            robot,
            None if values.seed < 0 else values.seed,
            position=values.initial_position or None,
            parameters=self._made(values.payload),
            profile=profile,
        )
        self._destroy_drone()
        self._drone = self._make_drone(config, drawn, robot, transport)
        self._sensors = EmulatedSensors(self.bridge, transport.plant, robot.link_names[-1], values)
        if values.truth_file:
            truth = transport.plant.true_parameters()
            if self._geometry is not None:
                truth['geometry'] = self._geometry.as_dict()
            text = yaml.safe_dump(truth, sort_keys=False)
            try:
                write_whole(Path(values.truth_file), text)
            except OSError as error:
                raise ValueError(
                    f'truth_file {values.truth_file} cannot be written '
                    f'({error.strerror}): check its path'
                ) from None
        if values.fault:
            FaultRequest.parse(values.fault, len(transport.boards)).apply(transport)
        return transport

    def _as_made(self, config: ArmConfig, robot: Robot) -> tuple[ArmConfig, Robot]:
        """Return configuration and model of the simulated arm, with its manufacturing errors."""
        values = self.bridge.values
        if values.hardware_config or values.hardware_urdf:
            own = SimpleNamespace(**vars(values))
            own.config = values.hardware_config or values.config
            own.urdf = values.hardware_urdf or values.urdf
            config, robot = _load_arm(own)
        self._geometry = None
        if values.geometry_seed < 0:
            return config, robot
        self._geometry = made = MadeGeometry.of(robot, values.geometry_seed)
        return made.config(config), made.robot

    def _make_drone(
        self, config: ArmConfig, drawn: Robot, robot: Robot, transport: EmulatedTransport
    ) -> EmulatedDrone | None:
        values = self.bridge.values
        profile, drone = values.base_motion_profile, load_drone(values, config, drawn)
        if drone is not None and self._geometry is not None:
            drone = self._geometry.drone(drone)
        if drone is None:
            if values.contact_force or values.wall:
                raise ValueError(_NO_DRONE)
            if profile == STILL:
                return None
            base = mount_on_base(transport, robot, BASE_PROFILES[profile])
            return EmulatedDrone(
                self.bridge, base, drone_parameters.imu(values, base), robot.base_link
            )
        if profile != STILL:
            raise ValueError(
                f'base_motion_profile is {profile} and drone_file is set, but a motion profile '
                'applies only to an arm without drone: remove one of the two parameters'
            )
        wind = drone_parameters.gust(values)
        plant = mount_on_drone(transport, robot, drone, values.rotor_timeout, wind)
        plant.touch(*drone_parameters.contact(values, plant))
        if (wall := drone_parameters.wall(values)) is not None:
            plant.build(wall, _WALL_LINK)
        sensors = (drone_parameters.imu(values, plant), drone_parameters.odometry(values, plant))
        others = drone_parameters.other_odometry(values, plant)
        return FlyingDrone(self.bridge, plant, *sensors, LAG[values.pace], robot.prefix, others)

    @property
    def _flying(self) -> FlyingDrone | None:
        return self._drone if isinstance(self._drone, FlyingDrone) else None

    def make_loop(self) -> PeriodicLoop:
        """Return the loop that calls the bridge's cycle, in simulation time or in real time."""
        self._destroy_time()
        if self.bridge.values.pace == REAL_TIME:
            return super().make_loop()
        start_ns = round(self._now * 1e9)
        self._time = EmulatedWorld(self.bridge, self.boards, self._flying, start_ns)
        return self._time.loop

    def now_ns(self) -> int:
        """Return the simulation time [ns since the epoch]; system time if pace is real_time."""
        return self._time.now_ns() if self._time is not None else super().now_ns()

    def newest_command(self) -> Command | None:
        """Return the newest joint command or None; the simulation may wait for a command."""
        time = self._time
        return time.newest_command() if time is not None else super().newest_command()

    def clean_up(self) -> None:
        """Destroy the ROS entities of drone, sensors and simulation time."""
        self._destroy_drone()
        self._destroy_time()

    def actions(self) -> Mapping[str, Action]:
        """Return actions by service name; they extend or replace the actions of a real arm."""
        return {
            'enable': self._enable,
            'home': self._home,
            'inject_fault': self._inject_fault,
            'put_back': self._put_back,
        }

    def statuses(self) -> Sequence[Status]:
        """Return the status of the drone for /diagnostics, or an empty tuple without a drone."""
        return () if self._flying is None else (self._flying.describe(),)

    def end_cycle(self, now: float, stamp_ns: int) -> None:
        """Simulate boards and arm until the time of the next cycle, while controllers compute."""
        self._now = now
        if self._drone is not None:
            # Before the arm moves, because a sample must be taken at the time of its stamp.
            self._drone.update(self.bridge.mode, stamp_ns)
        if self._sensors is not None:
            self._sensors.update(stamp_ns)
        self.boards.advance(now + self.bridge.values.period)
        if self._time is not None:
            self._time.end_cycle(self.bridge.mode)

    def parameter_problem(self, changes: Mapping[str, Any]) -> str:
        """Return why the node must reject new values of live parameters, or an empty string."""
        if self.bridge.cycle is None:
            return ''
        checks: dict[str, Callable[[Any], object]] = {
            'fault': lambda text: FaultRequest.parse(text, len(self.boards.boards)),
            'hand': lambda text: parse_turn(text, self.bridge.config.joint_names),
            'payload': self._made,
        }
        for name, check in checks.items():
            try:
                if name in changes and (changes[name] or name == 'payload'):
                    check(changes[name])
            except ValueError as error:
                return f'parameter {name}: {error}'
        return self._contact_problem(changes) if changes.keys() & set(CONTACT) else ''

    def _keep_awake(self, duration: float) -> None:
        if self._time is not None:
            self._time.keep_awake(duration)

    def _destroy_time(self) -> None:
        if self._time is not None:
            self._time.destroy()
            self._time = None

    def _destroy_drone(self) -> None:
        if self._sensors is not None:
            self._sensors.destroy()
            self._sensors = None
        if self._drone is not None:
            self._drone.destroy()
            self._drone = None

    def _enable(self, cycle: BridgeCycle) -> Answer:
        boards = self.boards
        if self._time is not None and self._time.is_waiting:
            cycle.intake.forget()  # The publisher is silent, so the bridge may hold the arm.
        if cycle.mode != 'idle':
            return cycle.enable()
        if cycle.gate.is_inside(cycle.q):
            boards.carry()
            what = ''
        else:
            boards.put_back()
            what = 'the fallen arm was reset to its initial configuration; '
        cycle.update(self._now)  # read the new positions and the zero velocity
        accepted, message = cycle.enable()
        return Answer(accepted, what + message)

    def _grasp(self, cycle: BridgeCycle) -> Answer:
        """Attach the payload of the parameter `payload` to the simulated arm."""
        self.boards.plant.grasp(self._made(self.bridge.values.payload))
        self._keep_awake(_EFFECT_TIME)
        return Answer(True, '')

    def _turn(self, cycle: BridgeCycle) -> Answer:
        """Turn one joint as the parameter `hand` describes."""
        turn = parse_turn(self.bridge.values.hand, self.bridge.config.joint_names)
        try:
            self._keep_awake(self.boards.turn(*turn))
        except ValueError as error:
            self.bridge.get_logger().warning(f'hand: {error}')
            return Answer(False, str(error))
        return Answer(True, '')

    def _contact_problem(self, changes: Mapping[str, Any]) -> str:
        plant = self.boards.plant
        if not isinstance(plant, FlyingPlant):
            return _NO_DRONE
        values = SimpleNamespace(**{**vars(self.bridge.values), **changes})
        try:
            drone_parameters.contact(values, plant)
        except ValueError as error:
            return f'the parameters contact_force and contact_link are invalid: {error}'
        return ''

    def _touch(self, cycle: BridgeCycle) -> Answer:
        """Apply the parameters `contact_force` and `contact_link` to the simulation."""
        plant = self.boards.plant
        if not isinstance(plant, FlyingPlant):
            return Answer(False, _NO_DRONE)
        plant.touch(*drone_parameters.contact(self.bridge.values, plant))
        return Answer(True, '')

    def _home(self, cycle: BridgeCycle) -> Answer:
        if cycle.mode not in OFF:
            return cycle.home()
        self.boards.put_at_rest()
        cycle.update(self._now)  # read the new positions and the zero velocity
        accepted, message = cycle.home()
        return Answer(accepted, f'the emulated arm was moved to its home configuration; {message}')

    def _inject_fault(self, cycle: BridgeCycle) -> Answer:
        fault, boards = self.bridge.values.fault, self.boards
        if not fault:
            return Answer(False, f'the parameter fault is empty: set it to {FORM} first')
        FaultRequest.parse(fault, len(boards.boards)).apply(boards)
        self._keep_awake(_EFFECT_TIME)
        return Answer(True, f'{fault}: {FAULTS[fault.partition(":")[0].strip()].meaning}')

    def _put_back(self, cycle: BridgeCycle) -> Answer:
        boards = self.boards
        if any(board.system_enabled for board in boards.boards):
            return Answer(False, 'the boards still drive motors: disable the arm first')
        boards.put_back()
        if self._flying is not None:
            self._flying.restart()
            self._keep_awake(_EFFECT_TIME)
        return Answer(
            True,
            'the simulated arm was reset to its initial configuration; the simulation supports the '
            'arm until its motors hold it',
        )
