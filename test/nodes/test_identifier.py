"""The identifier as a user runs it: one process, bags in, files out."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import rclpy
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import from_pseudo_inertia, is_physically_consistent, pseudo_inertia

RATE = 200.0
JOINTS = ('joint1', 'joint2', 'joint3', 'joint4')
STORE = get_typestore(Stores.ROS2_JAZZY)
FILES = ['estimate.yaml', 'identified.urdf', 'report.html', 'summary.json']


def write_bag(
    path: Path,
    stamp: np.ndarray,
    fields: tuple[np.ndarray, ...],
    names: tuple[str, ...] = JOINTS,
    topic: str = '/joint_states',
    desired: np.ndarray | None = None,
) -> Path:
    """Write a bag with a library that the identifier doesn't use."""
    state, header, when = (
        STORE.types[name]
        for name in (
            'sensor_msgs/msg/JointState',
            'std_msgs/msg/Header',
            'builtin_interfaces/msg/Time',
        )
    )
    nothing = np.zeros(0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection(topic, state.__msgtype__, typestore=STORE)
        commands = writer.add_connection('/joint_command', state.__msgtype__, typestore=STORE)
        for k, t in enumerate(stamp):
            nanoseconds = round(t * 1e9)
            time_of = when(nanoseconds // 10**9, nanoseconds % 10**9)
            message = state(header(time_of, ''), list(names), *(field[k] for field in fields))
            data = STORE.serialize_cdr(message, state.__msgtype__)
            # Reception is regular even where stamps are not.
            writer.write(states, 10**12 + round(1e9 * k / RATE), data)
            if desired is not None:
                command = state(header(time_of, ''), list(names), nothing, desired[k], nothing)
                data = STORE.serialize_cdr(command, state.__msgtype__)
                writer.write(commands, 10**12 + round(1e9 * k / RATE), data)
    return path


def motion(seed: int) -> tuple[np.ndarray, ...]:
    """Stamps, and q, dq, ddq over two periods of 10 s."""
    random = np.random.default_rng(seed)
    alpha, beta = random.uniform(-0.35, 0.35, (2, 4, 5))
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    omega = 0.2 * np.pi * np.arange(1, 6)
    s, c = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = np.array([0.0, np.pi / 2, 0.0, 0.0]) + s @ alpha.T + c @ beta.T
    dq = (c * omega) @ alpha.T - (s * omega) @ beta.T
    ddq = -(s * omega**2) @ alpha.T - (c * omega**2) @ beta.T
    return 1.7e9 + t, q, dq, ddq


def measured(robot: Robot, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Torques of an arm that is heavier than its URDF and has rotors and friction."""
    shift = np.eye(4)
    shift[:3, 3] = 0.008
    heavier = from_pseudo_inertia(1.2 * shift @ pseudo_inertia(robot.inertial_parameters) @ shift.T)
    model = robot.with_inertial_parameters(heavier).model
    data = model.createData()
    links = np.array([pin.rnea(model, data, *x) for x in zip(q, dq, ddq, strict=True)])
    noise = 0.03 * np.random.default_rng(0).standard_normal(q.shape)
    return links + 0.015 * ddq + 0.01 * dq + 0.2 * np.sign(dq) + noise


@pytest.fixture(scope='module')
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Path:
    """A folder with an identification and a validation bag."""
    folder = tmp_path_factory.mktemp('bags')
    for seed, name in ((1, 'identification'), (2, 'validation')):
        stamp, q, dq, ddq = motion(seed)
        write_bag(folder / name, stamp, (q, dq, measured(robot, q, dq, ddq)), desired=dq)
    return folder


def identifier(*arguments: object, **options: object) -> subprocess.CompletedProcess:
    command = [sys.executable, '-m', 'aerarm_ros.nodes.identifier', *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **options)


@pytest.fixture(scope='module')
def run(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Standard output and result folder of a good run, started as a launch file does."""
    out = tmp_path_factory.mktemp('run') / 'result'
    done = identifier(
        *('--bag', bags / 'identification', '--validation', bags / 'validation', '--out', out),
        *('--config', '', '--urdf', '', '--ros-args', '-r', '__node:=identifier'),
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, out


def test_all_files_are_there(run: tuple[str, Path]) -> None:
    output, out = run
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert [path.name for path in out.parent.iterdir()] == ['result']
    assert str(out / 'report.html') in output
    assert [line.split()[0] for line in output.splitlines()[2:6]] == ['cad', 'ols', 'wls', 'sdp']


def test_summary_tells_what_was_found(run: tuple[str, Path]) -> None:
    summary = json.loads((run[1] / 'summary.json').read_text())
    assert summary['samples'] == 4000
    assert summary['regressor']['thesis']['rank'] == 30
    sdp, cad = (summary['solvers'][name] for name in ('sdp', 'cad'))
    assert sdp['physically_consistent']
    assert sdp['min_pseudo_inertia_eigenvalue'] > 0.0
    assert sdp['validation'][0]['bag'] == 'validation'
    assert sdp['validation'][0]['filtered'] < 0.2 * cad['validation'][0]['filtered']
    assert summary['conditioning']['fundamental'] == pytest.approx(0.1)
    assert summary['seconds']['total'] == pytest.approx(
        sum(value for key, value in summary['seconds'].items() if key != 'total')
    )


def test_a_payload_is_weighed_and_slow_solvers_run_on_demand(
    bags: Path, robot: Robot, tmp_path: Path
) -> None:
    stamp, q, dq, ddq = motion(3)
    loaded = np.array(robot.inertial_parameters)
    point = np.array([0.1, 0.0, 0.0, 1.0])
    loaded[-1] += from_pseudo_inertia(
        0.25 * (np.outer(point, point) + 1e-3 * np.diag([1, 1, 1, 0]))
    )
    # `measured` makes the arm a fifth heavier, and displaces its matter, as without payload.
    tau = measured(robot.with_inertial_parameters(loaded), q, dq, ddq)
    write_bag(tmp_path / 'carrying', stamp, (q, dq, tau))
    out = tmp_path / 'out'
    done = identifier(
        *('--bag', bags / 'identification', '--payload', tmp_path / 'carrying', '--out', out),
        *('--solvers', 'huber'),
    )
    assert done.returncode == 0, done.stderr
    assert 'Payload: 0.' in done.stdout
    payload = yaml.safe_load((out / 'payload.yaml').read_text())['/**']['ros__parameters']
    assert payload['payload']['mass'] == pytest.approx(0.3, rel=0.02)
    assert len(payload['inertial_parameters']) == 40
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['payload']['mass'] == payload['payload']['mass']
    assert set(summary['solvers']) == {'cad', 'ols', 'huber', 'sdp'}
    assert 'carried by link4' in (out / 'report.html').read_text()


def test_urdf_reloads_and_is_physical(run: tuple[str, Path], robot: Robot) -> None:
    identified = load_robot(run[1] / 'identified.urdf')
    assert identified.joint_names == robot.joint_names
    assert is_physically_consistent(identified.inertial_parameters)
    assert identified.coulomb == pytest.approx([0.2] * 4, rel=0.1)
    assert np.array_equal(identified.position_max, robot.position_max)


def test_estimate_loads_as_ros_parameters(run: tuple[str, Path], ros_domain: object) -> None:
    file = run[1] / 'estimate.yaml'
    rclpy.init(args=['--ros-args', '--params-file', str(file)])
    try:
        node = rclpy.create_node('any', automatically_declare_parameters_from_overrides=True)
        assert list(node.get_parameter('joint_names').value) == list(JOINTS)
        rotor = np.array(node.get_parameter('rotor_inertia').value)
        assert rotor[2:] == pytest.approx([0.015] * 2, rel=0.1)
        assert len(node.get_parameter('inertial_parameters').value) == 40
        assert len(node.get_parameter('friction.coulomb').value) == 4
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_report_shows_desired_velocities(run: tuple[str, Path]) -> None:
    assert '"name":"desired"' in (run[1] / 'report.html').read_text()


def test_same_bags_same_bits(bags: Path, run: tuple[str, Path], tmp_path: Path) -> None:
    out = tmp_path / 'again'
    done = identifier(
        *('--bag', bags / 'identification', '--validation', bags / 'validation', '--out', out)
    )
    assert done.returncode == 0
    for name in ('estimate.yaml', 'identified.urdf'):
        assert (out / name).read_bytes() == (run[1] / name).read_bytes()


def test_truth_holdout_and_options(bags: Path, tmp_path: Path, robot: Robot) -> None:
    names = [f'{p}_{link}' for link in robot.link_names for p in ('m', 'mcx', 'mcy', 'mcz')]
    names += [
        f'{p}_{link}'
        for link in robot.link_names
        for p in ('Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
    ]
    truth = tmp_path / 'truth.yaml'
    truth.write_text(yaml.safe_dump({'parameters': dict.fromkeys(names, 0.01)}))
    done = identifier(
        *('--bag', bags / 'identification', '--holdout', 0.4, '--friction', 'coulomb'),
        *('--truth', truth, '--cutoff', 4, '--out', tmp_path / 'out', '--gravity', 0, 0, -9.81),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['conditioning']['cutoff'] == 4.0
    (held_out,) = summary['solvers']['sdp']['validation']
    assert held_out['bag'] == 'identification [last 40 %]'
    assert len(summary['inertial_torque_error']) == 8


def test_renamed_and_amperes(bags: Path, tmp_path: Path, robot: Robot) -> None:
    """Another naming, torque given as current of a motor with 0.5 Nm/A."""
    stamp, q, dq, ddq = motion(1)
    names = ('a', 'joint2', 'joint3', 'joint4')
    tau = measured(robot, q, dq, ddq) / [0.5, 1.0, 1.0, 1.0]
    bag = write_bag(tmp_path / 'other', stamp, (q, dq, tau), names, '/arm/joint_states')
    done = identifier(
        *('--bag', bag, '--topic', '/arm/joint_states', '--rename', 'a=joint1'),
        *('--effort-gain', 'joint1=0.5', '--out', tmp_path / 'out', '--friction', 'coulomb'),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['solvers']['sdp']['identification'][0]['filtered'] < 2.0


def faulty_bag(kind: str, folder: Path, robot: Robot) -> Path:
    stamp, q, dq, ddq = motion(1)
    tau = measured(robot, q, dq, ddq)
    names = JOINTS
    if kind == 'missing joints':
        names = ('joint1', 'joint2', 'elbow', 'hand')
    elif kind == 'NaN effort':
        tau[700:900, 1] = np.nan
    elif kind == 'repeated stamps':
        stamp[1000:1500] = stamp[1000]
    elif kind == 'jumping stamps':
        stamp[2000:] += 30.0
    elif kind == 'too short':
        stamp, q, dq, tau = stamp[:300], q[:300], dq[:300], tau[:300]
    elif kind == 'no motion':
        q[:], dq[:] = 0.3, 0.0
    elif kind == 'no effort':
        tau[:] = 0.0
    return write_bag(folder / 'bag', stamp, (q, dq, tau), names)


def check_refusal(done: subprocess.CompletedProcess, words: str, out: Path) -> None:
    """One line on standard error, exit status not zero, nothing written."""
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith('identifier: ')
    assert words in lines[0]
    assert not out.exists()
    assert not list(out.parent.glob('.*'))


@pytest.mark.parametrize(
    ('kind', 'words'),
    [
        ('missing joints', 'joint3, joint4 of the URDF are not in the bag'),
        ('NaN effort', 'effort of joints joint2 is NaN'),
        ('repeated stamps', 'repeated'),
        ('jumping stamps', 'jump by 30.0'),
        ('too short', 'too short'),
        ('no motion', 'no joint moves'),
        ('no effort', 'effort of every joint is constant'),
    ],
)
def test_faulty_bags_are_refused(kind: str, words: str, tmp_path: Path, robot: Robot) -> None:
    bag = faulty_bag(kind, tmp_path, robot)
    out = tmp_path / 'results' / 'out'
    out.parent.mkdir()
    check_refusal(identifier('--bag', bag, '--out', out), words, out)


def truncated(bags: Path, folder: Path) -> Path:
    bag = Path(shutil.copytree(bags / 'identification', folder / 'bag'))
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    return bag


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--bag', 'none'], 'none'),
        (['--bag', '{truncated}'], 'truncated'),
        (['--bag', '{bag}', '--topic', '/states'], '/states'),
        (['--bag', '{bag}', '--urdf', '{massless}'], 'has no mass'),
        (['--bag', '{bag}', '--urdf', 'none.urdf'], 'none.urdf'),
        (['--bag', '{bag}', '--config', 'none.yaml'], 'none.yaml'),
        (['--bag', '{bag}', '--truth', 'none.yaml'], 'none.yaml'),
        (['--bag', '{bag}', '--validation', 'none'], 'none'),
        (['--bag', '{bag}', '--holdout', '1.5'], '--holdout'),
        (['--bag', '{bag}', '--cutoff', '-3'], 'cutoff'),
        (['--bag', '{bag}', '--effort-gain', 'joint1=x'], '--effort-gain'),
        (['--bag', '{bag}', '--rename', 'joint1'], '--rename'),
        (['--bag', '{bag}', '--lock', 'wing'], 'wing'),
        (['--bag', '{bag}', '--friction', 'none'], '--friction'),
        ([], '--bag'),
    ],
)
def test_faulty_arguments_are_refused(
    arguments: list[str], words: str, bags: Path, tmp_path: Path, robot: Robot
) -> None:
    massless = tmp_path / 'massless.urdf'
    start = robot.urdf_text.index('<inertial>', robot.urdf_text.index('<link name="link3">'))
    end = robot.urdf_text.index('</inertial>', start) + len('</inertial>')
    massless.write_text(robot.urdf_text[:start] + robot.urdf_text[end:])
    places = {'bag': bags / 'identification', 'massless': massless}
    if '{truncated}' in arguments:
        places['truncated'] = truncated(bags, tmp_path)
    out = tmp_path / 'results' / 'out'
    out.parent.mkdir()
    filled = [argument.format(**places) for argument in arguments]
    check_refusal(identifier(*filled, '--out', out), words, out)


def test_places_that_cannot_be_written(bags: Path, tmp_path: Path) -> None:
    file = tmp_path / 'file'
    file.write_text('')
    for out in (file / 'out', Path('/proc/none/out')):
        done = identifier('--bag', bags / 'identification', '--out', out)
        assert done.returncode == 2
        assert len(done.stderr.strip().splitlines()) == 1
        assert '--out' in done.stderr
    assert file.read_text() == ''


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupted_runs_leave_nothing(bags: Path, tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.nodes.identifier']
    # Many bags, so that the process is busy when the signal comes.
    command += [
        '--bag',
        *[str(bags / 'identification')] * 200,
        '--out',
        str(tmp_path / 'r' / 'out'),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 30.0
    while not (tmp_path / 'r').exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(number)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert errors.strip() == 'identifier: interrupted, nothing was written'
    assert not list(tmp_path.iterdir())


def test_names_from_outside_are_escaped(tmp_path: Path, robot: Robot, bags: Path) -> None:
    """A joint, a link and a bag whose names are HTML."""
    nasty = '<script>alert(1)</script>'
    escaped = nasty.replace('<', '&lt;').replace('>', '&gt;')
    urdf = tmp_path / 'nasty.urdf'
    urdf.write_text(
        robot.urdf_text.replace('"joint3"', f'"{escaped}"').replace('"link3"', f'"{escaped}"')
    )
    bag = tmp_path / '<img src=x onerror=alert(2)>'
    shutil.copytree(bags / 'identification', bag)
    done = identifier(
        *('--bag', bag, '--urdf', urdf, '--rename', f'joint3={nasty}', '--out', tmp_path / 'out')
    )
    assert done.returncode == 0, done.stderr
    html = (tmp_path / 'out' / 'report.html').read_text()
    assert nasty not in html
    assert '<img' not in html.split('</head>')[1]
    assert load_robot(tmp_path / 'out' / 'identified.urdf').joint_names[2] == nasty
