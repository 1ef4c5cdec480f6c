"""Comparison of the identifier with FIGAROH and MuJoCo's system identification on one motion.

All tools receive the identifier's conditioned samples, with the first 60 % of each bag to fit and
the last 40 % held out, so models and solvers are compared independently of filters. Each tool runs
in a separate virtual environment, created with pip on first use in build/peers (or the folder in
AERARM_PEERS). A tool that cannot be installed is skipped with the reason.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import files
from pathlib import Path
from xml.etree import ElementTree

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from peers.peer import Peer

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.solvers.solvers import SOLVERS
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags
from aerarm_ros.simulation.arm_plant import PlantParameters

TRAINING = 0.6


PEERS = (
    Peer('FIGAROH', ('figaroh',), ('figaroh',), 'identification_figaroh.py'),
    Peer(
        'MuJoCo sysid',
        ('mujoco[sysid]>=4',),
        ('mujoco.sysid._src.residual',),
        'identification_sysid.py',
    ),
)


def bare_urdf(robot: Robot, locked: tuple[str, ...]) -> str:
    """Return the URDF without shapes and with locked joints fixed: the same arm for every tool."""
    root = ElementTree.fromstring(robot.urdf_text)
    for link in root.findall('link'):
        for child in [c for c in link if c.tag in ('visual', 'collision')]:
            link.remove(child)
    for joint in root.findall('joint'):
        if joint.get('name') in locked:
            joint.set('type', 'fixed')
        for child in [c for c in joint if c.tag in ('dynamics', 'mimic', 'safety_controller')]:
            joint.remove(child)
    for other in [c for c in root if c.tag not in ('link', 'joint')]:
        root.remove(other)
    return ElementTree.tostring(root, encoding='unicode')


def write_samples(path: Path, result: IdentificationResult) -> None:
    """Write the samples that every tool fits and predicts: usable rows of all joints."""
    parts = {}
    for name, bags in (('fit', result.identification), ('held', result.validation)):
        for field in ('q', 'dq', 'ddq', 'tau'):
            parts[f'{name}_{field}'] = np.concatenate([_rows(bag, field) for bag in bags])
    np.savez(path, joints=np.array(result.robot.joint_names), **parts)


def _rows(bag: SampleColumns, field: str) -> np.ndarray:
    return getattr(bag.samples, field)[bag.samples.usable.all(axis=1)]


def compare(
    title: str,
    bag: Path,
    robot: Robot,
    config: ArmConfig | None,
    mapping: JointMapping,
    peers: Sequence[Peer],
    solvers: tuple[str, ...] = ('wls', 'entropic'),
) -> None:
    """Print a table of this package's solvers and the other tools on one bag."""
    recording = (
        IdentifierBags('/joint_states', robot.joint_names, mapping).read(bag, title).recording
    )
    parts = [recording.part(0.0, TRAINING, ''), recording.part(TRAINING, 1.0, '')]
    options = IdentificationOptions(solvers=solvers)
    result = identify(robot, config, parts[:1], parts[1:], options, Stopwatch())
    print(f'\n{title:24s} held-out torque error [%]   physically consistent   solver [s]')
    for name, solution in result.solutions.items():
        estimate = solution.estimate
        row(name, solution.validation[0].filtered, estimate.physically_consistent, estimate.seconds)
    with tempfile.TemporaryDirectory() as folder:
        samples, urdf = Path(folder) / 'samples.npz', Path(folder) / 'arm.urdf'
        write_samples(samples, result)
        urdf.write_text(bare_urdf(robot, mapping.locked))
        for peer in peers:
            found = peer.run(samples, urdf)
            if 'skipped' in found:
                print(f'{peer.name:24s} left out: {found["skipped"]}')
            else:
                row(peer.name, found['error'], found['consistent'], found['seconds'])


def row(name: str, error: float, consistent: bool, seconds: float) -> None:
    print(f'{name:24s} {error:25.2f}   {"yes" if consistent else "no":>21s}   {seconds:10.3f}')


def measured_robot(file: str, locked: tuple[str, ...] = ()) -> Robot:
    """Return an arm of the package example-robot-data."""
    found = next(
        f for f in files('example-robot-data') or () if f.name == file and f.parent.name == 'urdf'
    )
    return load_robot(Path(str(found.locate())), locked=list(locked))


def compare_all(peers: Sequence[Peer] = PEERS) -> int:
    """Compare solvers and other tools on a simulated and on the measured bags."""
    # Module in this folder that writes the simulated bag.
    from identification import DATASETS, write_bag

    with tempfile.TemporaryDirectory() as folder:
        bag, robot, config = Path(folder) / 'bag', load_robot(), load_arm_config()
        write_bag(bag, robot, PlantParameters.nominal(config, robot), 20.0)
        compare('Simulated arm, 20 s', bag, robot, config, JointMapping({}), peers, tuple(SOLVERS))
    if DATASETS is None:
        print('UR10 and Panda were skipped: set AERARM_DATASETS')
        return 0
    ur10 = measured_robot('ur10_robot.urdf')
    compare('UR10', Path(DATASETS, 'ur10_excitation'), ur10, None, JointMapping({}), peers)
    fingers = ('panda_finger_joint1', 'panda_finger_joint2')
    names = {f'fer_joint{i}': f'panda_joint{i}' for i in range(1, 8)}
    panda = measured_robot('panda.urdf', fingers)
    mapping = JointMapping(names, locked=fingers)
    compare('Panda', Path(DATASETS, 'panda_excitation'), panda, None, mapping, peers)
    return 0


if __name__ == '__main__':
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    sys.exit(compare_all())
