"""Arm model for a controller: true parameters, or parameters identified from a bag."""

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path
from subprocess import TimeoutExpired

import numpy as np
import yaml
from flying.node_bench import ros_node
from rclpy.node import Node

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.files.identified_robot import LoadFriction, identified_urdf
from aerarm_ros.model.inertia import barycentric_inertia, parameters_of_body
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient
from aerarm_ros.simulation.arm_plant import PlantParameters

AS_DRAWN = -1
_PATIENCE = 600.0  # [s]


@dataclass(frozen=True)
class ArmModel:
    """Emulated arm, and the model of it that the controllers use.

    Attributes
    ----------
    seed : int
        Seed of the arm's deviations from its model.
    law : dict
        Parameters of a controller.
    """

    name: str
    seed: int
    law: dict[str, object]

    @property
    def drawing(self) -> dict[str, object]:
        """Parameters of a node that needs the arm's masses; empty for the nominal arm."""
        return {key: self.law[key] for key in ('urdf',) if key in self.law}

    @classmethod
    def true(cls) -> 'ArmModel':
        """Return a nominal arm with its exact model."""
        nominal = PlantParameters.nominal(load_arm_config(), load_robot())
        return cls('true', AS_DRAWN, {'load_friction': nominal.load_friction.tolist()})

    @staticmethod
    def add_options(parser: argparse.ArgumentParser, default: str = 'identified') -> None:
        """Add the options that choose the model."""
        parser.add_argument('--model', choices=('identified', 'true'), default=default)
        parser.add_argument('--arm-seed', type=int, default=7, help='seed of the identified arm')

    @classmethod
    def chosen(cls, options: argparse.Namespace, folder: Path) -> 'ArmModel':
        """Return the model that the options choose."""
        if options.model == 'true':
            return cls.true()
        with ros_node() as node:
            return cls.identified(node, folder, options.arm_seed)

    @classmethod
    def identified(cls, node: Node, folder: Path, seed: int) -> 'ArmModel':
        """Return an arm that deviates from its model, with parameters identified from its motion.

        The excitation is played on a fixed base and recorded in lockstep, as a user would do.
        """
        bag, result = folder / 'bag', folder / 'result'
        record_excitation(node, folder, bag, seed)
        arguments = ['--bag', str(bag), '--out', str(result)]
        with NodeProcess('identifier', arguments, log=folder / 'identifier.log') as identifier:
            _require_good_end(identifier)
        estimate = yaml.safe_load((result / 'estimate.yaml').read_text())
        values = estimate['/**']['ros__parameters']
        law = {
            'urdf': result / 'identified.urdf',
            'rotor_inertia': values['rotor_inertia'],
            'load_friction': values['friction']['load'],
        }
        return cls('identified', seed, law)

    def with_errors(self, share: float, seed: int, folder: Path) -> 'ArmModel':
        """Return the same arm with a wrong model, in which every link deviates by a relative error.

        Mass, each coordinate of the centre of mass, and inertia are increased or decreased
        depending on the seed; the true arm is unchanged.
        """
        robot, draws = load_robot(self.law.get('urdf')), np.random.default_rng(seed)
        believed = []
        for link in robot.inertial_parameters:
            wrong = 1.0 + share * draws.choice([-1.0, 1.0], 5)
            mass, centre = wrong[0] * link[0], wrong[1:4] * link[1:4] / link[0]
            inertia = wrong[4] * barycentric_inertia(link)
            believed.append(parameters_of_body(mass, centre, inertia))
        friction = robot.viscous, robot.coulomb
        load = LoadFriction(robot.load_friction, *friction)
        path = folder / 'wrong.urdf'
        path.write_text(identified_urdf(robot, np.array(believed), *friction, load).text)
        name = f'{self.name}, {100.0 * share:g} % wrong'
        return replace(self, name=name, law={**self.law, 'urdf': path})


def record_excitation(node: Node, folder: Path, bag: Path, seed: int, priority: int = 0) -> float:
    """Play an excitation of 20 s in lockstep and record it; return the duration [s] of its node."""
    arm = ArmClient(node, ['fake_hardware'])
    world = {'pace': 'lockstep', 'encoders': 'absolute', 'seed': seed}
    motion = {'seed': 1, 'periods': 2, 'wait_for_recorder': True}
    first, second = ({'realtime_priority': max(0, priority - k)} for k in (0, 1))
    with NodeProcess('fake_hardware', (), world | first, log=folder / 'hardware.log'):
        arm.wait_for_mode(['idle'], _PATIENCE)
        arm.call('enable')
        arm.wait_for_mode(['ready'], _PATIENCE)
        with NodeProcess('recorder', (), {'bag': bag}, log=folder / 'recorder.log'):
            begin, log = time.monotonic(), folder / 'excitation.log'
            with NodeProcess('excitation', (), motion | second, log=log) as excitation:
                _require_good_end(excitation)
            return time.monotonic() - begin


def _require_good_end(process: NodeProcess) -> None:
    """Wait for a process to end; raises ValueError with its last output if it failed."""
    try:
        status = process.wait(_PATIENCE)
    except TimeoutExpired:
        raise ValueError(f'{process.name} did not end: {process.tail(3)}') from None
    if status != 0:
        raise ValueError(f'{process.name} failed: {process.tail(3)}')
