"""Emulated boards whose arm hangs under, or stands on, a base that moves or flies."""

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport
from aerarm_ros.simulation.arm_plant import ArmPlant
from aerarm_ros.simulation.base_profile import BaseProfile
from aerarm_ros.simulation.flying_plant import FlyingPlant
from aerarm_ros.simulation.moving_base_plant import MovingBasePlant
from aerarm_ros.simulation.random_drift import RandomDrift


def mount_on_base(
    transport: EmulatedTransport, robot: Robot, profile: BaseProfile
) -> MovingBasePlant:
    """Put the arm of emulated boards, as it is, on a base that follows a profile.

    Parameters
    ----------
    transport
        Made by `make_emulated_transport`, before its first exchange.
    robot
        The arm as drawn.
    profile
        Motion of the base, which begins with the plant's `start`.

    Returns
    -------
    MovingBasePlant
        The transport's plant from now on, with the parameters of the one before.
    """
    before = _without_play(transport)
    plant = MovingBasePlant(robot, before.parameters, before.position, profile)
    transport.plant = plant
    transport.carry()
    return plant


def mount_on_drone(
    transport: EmulatedTransport,
    robot: Robot,
    drone: DroneConfig,
    rotor_timeout: float,
    gust: RandomDrift | None = None,
) -> FlyingPlant:
    """Put the arm of emulated boards, as it is, under a drone.

    Parameters
    ----------
    transport, robot
        As of `mount_on_base`.
    drone, rotor_timeout, gust
        As of `FlyingPlant`.

    Returns
    -------
    FlyingPlant
        The transport's plant from now on, with the arm's parameters of the one before.
    """
    before = _without_play(transport)
    plant = FlyingPlant(robot, before.parameters, before.position, drone, rotor_timeout, gust)
    transport.plant = plant
    transport.carry()
    return plant


def _without_play(transport: EmulatedTransport) -> ArmPlant:
    """Return the transport's plant, which must have no play: no base but a still one knows any."""
    plant = transport.plant
    if plant.parameters.backlash is not None:
        raise ValueError('backlash is emulated on a base that stands still only: leave it out')
    return plant
