"""Drone configurations of arbitrary mass, and their files."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import yaml

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot


def scaled_drone(mass: float) -> DroneConfig:
    """Return a drone of a mass [kg]: the quadrotor up to 1.5 kg, otherwise the hexarotor.

    Lengths are constant, inertia is proportional to mass^(5/3), and thrust is proportional to the
    weight of drone and arm.
    """
    name = ('drones', 'quadrotor.yaml') if mass < 1.5 else ('drone.yaml',)
    drone = load_drone_config(resource('config', *name))
    arm = float(load_robot().inertial_parameters[:, 0].sum())
    thrust = (mass + arm) / (drone.mass + arm)
    rotors = tuple(replace(r, thrust_max=thrust * r.thrust_max) for r in drone.rotors)
    # Rotors first, because each intermediate drone must be able to fly.
    strong = replace(drone, rotors=rotors)
    return strong.with_errors(mass / drone.mass, (mass / drone.mass) ** (5 / 3))


def write_drone(drone: DroneConfig, path: Path) -> Path:
    """Write a drone configuration file."""
    path.write_text(yaml.safe_dump(json.loads(json.dumps(asdict(drone)))))
    return path
