import pytest

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.simulation.arm_plant import PlantParameters


@pytest.fixture(scope='session')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def model(config: ArmConfig, robot: Robot) -> EnergyModel:
    """Return the energy model of the emulated arm as drawn, with load-dependent friction."""
    load = PlantParameters.nominal(config, robot).load_friction
    return EnergyModel(config, robot, load_friction=load)
