"""Where the energy of recorded motion went, by the identified model."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.identification.assessment.identification_result import IdentificationResult


def bag_energies(config: ArmConfig, result: IdentificationResult) -> dict[str, EnergyBalance]:
    """Return the balance of each bag, by its name, where the filter has settled.

    Torque is the measured one, filtered; links and rotors are the identified ones, and friction is
    what the recommended estimate predicts besides them.

    Parameters
    ----------
    config : ArmConfig
        Motors with resistances, and the power stage. Empty is returned if it is another arm's.
    result : IdentificationResult
    """
    robot, solution = result.robot, result.recommended
    if config.joint_names != robot.joint_names:
        return {}
    estimate = solution.estimate
    theta = dict(zip(estimate.model.columns, estimate.theta.tolist(), strict=True))
    rotors = [max(theta.get(f'Ja_{name}', 0.0), 0.0) for name in robot.joint_names]
    model = EnergyModel(config, robot.with_inertial_parameters(estimate.inertial), rotors)
    balances = {}
    bags = [*result.identification, *result.validation]
    assessed = [*solution.identification, *solution.validation]
    for bag, assessment in zip(bags, assessed, strict=True):
        samples, kept = bag.samples, bag.samples.kept
        rigid, weight = model.torques(samples.q[kept], samples.dq[kept], samples.ddq[kept])
        friction = assessment.prediction.filtered[kept] - rigid
        dt = float(np.median(np.diff(samples.time)))
        balances[assessment.bag] = model.split(
            dt, samples.dq[kept], samples.tau[kept], rigid - weight, weight, friction
        )
    return balances
