"""A payload of 0.2 kg on the emulated arm: through the boards' frames, bags and command line."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from emulated_arm import EmulatedArm
from forked_executable import run as run_executable
from identifier_process import identifier

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.model.inertia import is_physically_consistent
from aerarm_ros.simulation.arm_plant import PlantParameters

MASS, CENTRE = 0.2, (0.1, 0.01, -0.02)


def record_both(folder: Path) -> None:
    """Record random trajectories of the arm alone, and of the arm with the payload."""
    config = load_arm_config()
    robot = load_robot(joint_names=config.joint_names)
    setup = ExcitationSetup.of_arm(robot, config, load_excitation_config())
    codec = JointStateCdr(config.joint_names)
    topic = RecordedTopic('/joint_states', 'sensor_msgs/msg/JointState')
    alone = PlantParameters.nominal(config, robot).perturbed(3)
    arms = (('without', alone), ('with', alone.carrying(MASS, CENTRE, 0.03)))
    for seed, (name, truth) in enumerate(arms, 1):
        trajectory, _ = setup.random_trajectory(0.35, 0.1, 5).draw_feasible(
            seed, setup.checker, setup.config.ramp_time
        )
        arm = EmulatedArm(config, robot, truth, np.array(config.rest_position), seed)
        motion = setup.planner.plan(trajectory, 1, arm.posture, go_back=False)
        with BagWriter(folder / name, [topic]) as writer:
            for number, state in enumerate(arm.play(motion), 1):
                payload = bytes(codec.pack(state.stamp_ns, state.q, state.dq, state.tau))
                writer.write(RecordedMessage(0, payload, state.stamp_ns, state.stamp_ns, number))


@pytest.fixture(scope='module')
def bags(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    return made_once('payload_bags', record_both)


@pytest.fixture(scope='module')
def run(bags: Path, made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Result folder of a good run."""

    def fill(folder: Path) -> None:
        payload = ('--payload', bags / 'with')
        done = identifier('--bag', bags / 'without', *payload, '--out', folder / 'out')
        assert done.returncode == 0, done.stderr

    return made_once('payload_run', fill) / 'out'


def check(file: Path) -> dict:
    payload = yaml.safe_load(file.read_text())['/**']['ros__parameters']['payload']
    assert payload['mass'] == pytest.approx(MASS, rel=0.02)
    assert payload['centre'] == pytest.approx(CENTRE, abs=2e-3)
    assert is_physically_consistent(np.array(payload['inertial_parameters']))
    assert 0.0 < payload['mass_standard_deviation'] < 0.01 * MASS
    return payload


def test_from_one_motion_with_the_arm_as_it_was_identified(
    run: Path, bags: Path, tmp_path: Path
) -> None:
    out = tmp_path / 'out'
    done = identifier('--model', run / 'estimate.yaml', '--payload', bags / 'with', '--out', out)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('Payload: 0.2')
    assert sorted(path.name for path in out.iterdir()) == ['payload.yaml', 'summary.json']
    alone, both = check(out / 'payload.yaml'), check(run / 'payload.yaml')
    assert alone['mass'] == pytest.approx(both['mass'], rel=5e-3)
    assert json.loads((out / 'summary.json').read_text())['payload']['mass'] == alone['mass']
    # The estimator that learns while an arm works, over the same bags.
    bare, loaded, online = bags / 'without', bags / 'with', tmp_path / 'online'
    done = run_executable(
        *('payload_estimator', '--bag', bare, loaded),
        *('--model', run / 'estimate.yaml', '--out', online),
        # The model was identified on this arm: it is wrong by less than the 1 % that is assumed.
        *('--model-error', '0.004'),
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r'^with: .* picked up at 0\.', done.stdout, re.M)
    told = check(online / 'payload.yaml')
    for name, std in (('inertial_parameters', 'standard_deviation'),
                      ('centre', 'centre_standard_deviation')):  # fmt: skip
        assert (np.abs(np.subtract(told[name], alone[name])) < told[std]).all()


def test_defects_of_the_payload_bag_are_reported(run: Path, bags: Path, tmp_path: Path) -> None:
    bag = Path(shutil.copytree(bags / 'with', tmp_path / 'with'))
    metadata = bag / 'metadata.yaml'
    metadata.write_text(re.sub(r'message_count: \d+', 'message_count: 9', metadata.read_text()))
    model = ('--model', run / 'estimate.yaml')
    done = identifier(*model, '--payload', bag, '--out', tmp_path / 'out')
    assert done.returncode == 0, done.stderr
    assert done.stderr.count('but metadata.yaml lists 9') == 1


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ('--model {run}/estimate.yaml', 'pass the bags with the payload as --payload'),
        ('--model {run}/estimate.yaml --payload {bags}/with --bag {bags}/with', 'remove --bag'),
        ('--model {run}/summary.json --payload {bags}/with', 'is not an estimate'),
        ('--model none.yaml --payload {bags}/with', 'none.yaml'),
        ('--model {run}/estimate.yaml --payload {bags}/without', 'no payload found'),
        ('--payload {bags}/with', '--bag'),
    ],
)
def test_faulty_arguments_are_one_line(
    arguments: str, words: str, run: Path, bags: Path, tmp_path: Path
) -> None:
    done = identifier(*arguments.format(run=run, bags=bags).split(), '--out', tmp_path / 'out')
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert words in line
    assert not list(tmp_path.iterdir())
