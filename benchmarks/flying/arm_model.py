"""What a controller is told of the arm: its true parameters, or those identified from a bag."""

from dataclasses import dataclass
from pathlib import Path
from subprocess import TimeoutExpired

import yaml
from rclpy.node import Node

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient
from aerarm_ros.simulation.plant_parameters import PlantParameters

AS_DRAWN = -1
_PATIENCE = 600.0  # [s]


@dataclass(frozen=True)
class ArmModel:
    """An emulated arm, and what is known of it.

    Attributes
    ----------
    name : str
    seed : int
        Of the arm's deviations from its drawing.
    law : dict
        Parameters of a controller.
    """

    name: str
    seed: int
    law: dict[str, object]

    @classmethod
    def true(cls) -> 'ArmModel':
        """Return an arm as drawn, and its drawing."""
        nominal = PlantParameters.nominal(load_arm_config(), load_robot())
        return cls('true', AS_DRAWN, {'load_friction': nominal.load_friction.tolist()})

    @classmethod
    def identified(cls, node: Node, folder: Path, seed: int) -> 'ArmModel':
        """Return an arm that differs from its drawing, and what its motion tells of it.

        The excitation is played on a fixed base and recorded, in lockstep, as people do it.
        """
        bag, result = folder / 'bag', folder / 'result'
        _record(node, folder, bag, seed)
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


def _record(node: Node, folder: Path, bag: Path, seed: int) -> None:
    arm = ArmClient(node, ['fake_hardware'])
    world = {'pace': 'lockstep', 'seed': seed}
    motion = {'seed': 1, 'periods': 2, 'subscribers': 2, 'wait_for_recorder': True}
    with NodeProcess('fake_hardware', (), world, log=folder / 'hardware.log'):
        arm.wait_for_mode(['idle'], _PATIENCE)
        arm.call('enable')
        arm.wait_for_mode(['ready'], _PATIENCE)
        with NodeProcess('recorder', (), {'bag': bag}, log=folder / 'recorder.log'):
            log = folder / 'excitation.log'
            with NodeProcess('excitation', (), motion, log=log) as excitation:
                _require_good_end(excitation)


def _require_good_end(process: NodeProcess) -> None:
    """Wait for a process; raises ValueError with its last words if it failed."""
    try:
        status = process.wait(_PATIENCE)
    except TimeoutExpired:
        raise ValueError(f'{process.name} does not end: {process.tail(3)}') from None
    if status != 0:
        raise ValueError(f'{process.name} failed: {process.tail(3)}')
