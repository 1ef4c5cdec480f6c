"""The emulated arm, which picks up a payload while it moves, and puts it down."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from emulated_arm import EmulatedArm

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.payload_estimator import EstimatorSettings, PayloadEstimator
from aerarm_ros.simulation.arm_plant import PlantParameters, Spread

LET_GO = 600  # cycles after which a person who carried the arm has released it
RADIUS = 0.03  # [m] of the payload ball
# As after a motor bench: torque constants are known.
SPREAD = Spread(torque_constant=0.0)
# Coulomb friction of the model over the true one.
COLD = 1.15


@dataclass(frozen=True, eq=False)
class CarryingRun:
    """One run, one row per cycle: time [s], q, dq and tau; and the true payload of the arm."""

    rows: np.ndarray
    truth: PlantParameters
    payload: np.ndarray
    pick_up: float
    put_down: float

    @classmethod
    def record(
        cls,
        seed: int,
        load: tuple[float, float, float, float] = (0.2, 0.1, 0.01, -0.02),
        pick_up: float = 2.6,
        put_down: float = 5.0,
        end: float = 5.6,
    ) -> Self:
        """Play an excitation; `load` is mass [kg] and centre [m].

        The arm deviates from its nominal parameters by `seed`, unless that is negative.
        """
        config, robot = load_arm_config(), load_robot()
        setup = ExcitationSetup.of_arm(robot, config, load_excitation_config())
        trajectory, _ = setup.random_trajectory(0.35, 0.1, 5).draw_feasible(
            abs(seed), setup.checker, setup.config.ramp_time
        )
        truth = true_arm(seed)
        loaded = truth.carrying(load[0], load[1:], RADIUS)
        arm = EmulatedArm(config, robot, truth, np.array(config.rest_position), abs(seed))
        motion = setup.planner.plan(trajectory, 2, arm.posture, go_back=False)
        rows: list[np.ndarray] = []
        for state in arm.play(motion):
            time = 1e-3 * len(rows)
            if abs(time - pick_up) < 1e-6:
                arm.plant.grasp(loaded)
            elif abs(time - put_down) < 1e-6:
                arm.plant.grasp(truth)
            elif time > end:
                break
            rows.append(np.concatenate([[time], state.q, state.dq, state.tau]))
        payload = (loaded.inertial_parameters - truth.inertial_parameters)[-1]
        return cls(np.array(rows), truth, payload, pick_up, put_down)

    @classmethod
    def load(cls, path: Path, seed: int, pick_up: float = 2.6, put_down: float = 5.0) -> Self:
        """Read the rows that `record` has written."""
        table = np.load(path)
        return cls(table[:-1], true_arm(seed), table[-1, :10], pick_up, put_down)

    def save(self, path: Path) -> None:
        """Write the rows, followed by the payload."""
        np.save(path, np.vstack([self.rows, np.resize(self.payload, self.rows.shape[1])]))

    def states(self) -> list[tuple[float, ArmState]]:
        """Return time and state of every cycle."""
        return [(row[0], ArmState(*np.split(row[1:], 3))) for row in self.rows[LET_GO:]]

    def robot(self) -> Robot:
        """Return the true arm, without payload."""
        return load_robot().with_inertial_parameters(self.truth.inertial_parameters)

    def estimator(self, settings: EstimatorSettings | None = None) -> PayloadEstimator:
        """Return an estimator with the arm's model, and friction of another day."""
        truth = self.truth
        dynamics = MovingBaseDynamics(self.robot(), truth.rotor_inertia)
        coulomb = COLD * truth.coulomb
        return PayloadEstimator(dynamics, truth.viscous, coulomb, truth.load_friction, settings)


def true_arm(seed: int) -> PlantParameters:
    """Return the true parameters of the arm of a seed."""
    drawn = PlantParameters.nominal(load_arm_config(), load_robot())
    return drawn if seed < 0 else drawn.perturbed(seed, SPREAD)
