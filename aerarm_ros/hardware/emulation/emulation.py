"""Creation of emulated boards with a simulated arm, on a fixed base, a moving base or a drone."""

from collections.abc import Sequence
from typing import TypeVar

from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import MotorConfig
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming, EmulatedHeat
from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport
from aerarm_ros.hardware.frames.frame_profile import FrameProfile, load_profile
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, PlantParameters, Spread
from aerarm_ros.simulation.backlash_plant import BacklashPlant
from aerarm_ros.simulation.base_profile import BaseProfile
from aerarm_ros.simulation.flying_plant import FlyingPlant, MovingBasePlant
from aerarm_ros.simulation.sensors import BandLimitedNoise, RandomDrift


def mount_on_base(
    transport: EmulatedTransport, robot: Robot, profile: BaseProfile
) -> MovingBasePlant:
    """Mount the simulated arm of a transport on a base that follows a motion profile.

    Parameters
    ----------
    transport
        Transport from `make_emulated_transport`, before its first exchange.
    robot
        Nominal robot model.
    profile
        Motion of the base as a function of the time since the call of `start` of the plant.

    Returns
    -------
    MovingBasePlant
        New simulation of the transport, with the arm parameters of the previous one.
    """
    before = _without_backlash(transport)
    plant = MovingBasePlant(robot, before.parameters, before.position, profile)
    transport.plant = plant
    transport.carry()
    return plant


def mount_on_drone(
    transport: EmulatedTransport,
    robot: Robot,
    drone: DroneConfig,
    rotor_timeout: float,
    gust: RandomDrift | BandLimitedNoise | None = None,
) -> FlyingPlant:
    """Mount the simulated arm of a transport under a simulated drone.

    Parameters
    ----------
    transport, robot
        See `mount_on_base`.
    drone, rotor_timeout, gust
        See `FlyingPlant`.

    Returns
    -------
    FlyingPlant
        New simulation of the transport, with the arm parameters of the previous one.
    """
    before = _without_backlash(transport)
    plant = FlyingPlant(robot, before.parameters, before.position, drone, rotor_timeout, gust)
    transport.plant = plant
    transport.carry()
    return plant


def _without_backlash(transport: EmulatedTransport) -> ArmPlant:
    """Return the simulated arm of a transport; raise ValueError if its gears have backlash."""
    plant = transport.plant
    if plant.parameters.backlash is not None:
        raise ValueError(
            'backlash is emulated only for an arm on a fixed base: remove the backlash'
        )
    return plant


T = TypeVar('T')
# Placeholder motor of a channel without a joint.
_NO_MOTOR = MotorConfig('none', 12, 300.0, 1.0, 1e-5, 1.0)


def make_emulated_transport(
    config: ArmConfig,
    robot: Robot,
    seed: int | None = 0,
    *,
    position: ArrayLike | None = None,
    spread: Spread | None = None,
    alignment: AlignmentTiming | None = None,
    encoder_zeros: Sequence[float | None] | None = None,
    pulse_offset: Sequence[float] | None = None,
    parameters: PlantParameters | None = None,
    profile: FrameProfile | None = None,
) -> EmulatedTransport:
    """Return a transport to emulated boards that drive a simulated arm.

    Parameters
    ----------
    config, robot
        Nominal configuration and robot model.
    seed
        Seed of the noise and of the arm's deviations from its nominal model; None for a nominal
        arm.
    position
        Initial joint angles (n,) [rad]; by default the home configuration.
    spread
        Bounds of the arm's deviations from its nominal model.
    alignment
        Durations of the boards' alignment.
    encoder_zeros
        True motor angles (n,) [rad], in joint order, at which the encoders count zero. By default
        incremental encoders count from the arm's position at power-on, and absolute encoders from
        the zero given by the configured offsets.
    pulse_offset
        True motor angles (n,) [rad] of the index pulses, modulo one turn; zero by default.
    parameters
        True parameters of the arm, replacing `seed` and `spread`.
    profile
        Frame layout of the boards; by default the configured one.

    Raises
    ------
    ValueError
        If configuration and URDF do not match, or the profile cannot be read.
    """
    if parameters is None:
        parameters = PlantParameters.nominal(config, robot)
        if seed is not None:
            parameters = parameters.perturbed(seed, spread)
    made = ArmPlant if parameters.backlash is None else BacklashPlant
    plant = made(robot, parameters, config.rest_position if position is None else position)
    profile = profile or load_profile(config.profile)
    knows = config.absolute_encoders(profile.encoders)
    if encoder_zeros is None:
        encoder_zeros = [0.0 if is_absolute else None for is_absolute in knows]
    heats = [EmulatedHeat.of_joint(joint, parameters.seed) for joint in config.joints]

    def by_channel(values: Sequence[T], unused: T) -> list[list[T]]:
        """Return the joints' values per board and channel, with a value of unused channels."""
        rows = [[unused, unused] for _ in config.boards]
        for joint, value in zip(config.joints, values, strict=True):
            rows[joint.board][joint.channel] = value
        return rows

    rows = zip(
        by_channel([joint.motor for joint in config.joints], _NO_MOTOR),
        by_channel(heats, None),
        by_channel(encoder_zeros, None),
        by_channel(knows, False),
        by_channel(pulse_offset or [0.0] * config.n, 0.0),
        strict=True,
    )
    boards = [
        EmulatedBoard(
            profile,
            motors,
            SUBSTEP,
            seed=1000 * (seed or 0) + number,
            heats=warmth,
            alignment=alignment,
            zeros=zeros,
            absolute=absolute,
            pulse_offsets=pulses,
        )
        for number, (motors, warmth, zeros, absolute, pulses) in enumerate(rows)
    ]
    return EmulatedTransport(boards, plant, config)
