"""The designer as a program: files, messages, stops."""

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from aerarm_ros.description.resources import resource
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.nodes.excitation_designer import main
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.programs.design_run import whole_periods

SMALL = ['--harmonics', '2', '--starts', '1', '--workers', '1']
PATIENT = '--time-limit', '600'  # for a busy host; it is over much earlier


def test_a_duration_is_a_whole_number_of_periods() -> None:
    assert whole_periods(20.0, 0.1) == 2
    # 0.3 has no exact binary fraction, and 10 / 3 s no exact decimal one.
    assert whole_periods(10.0, 0.3) == 3


def test_writes_trajectory_and_validation(tmp_path: Path, capsys) -> None:
    out = tmp_path / 'best.yaml'
    examples = resource('config', 'examples')
    arguments = [*SMALL, *PATIENT, '--out', str(out), '--fundamental', '0.25', '--harmonics', '3']
    for option, file in (('--config', 'yaml'), ('--urdf', 'urdf')):
        arguments += [option, str(examples / f'three_joints.{file}')]
    arguments += ['--excitation-config', str(examples / 'three_joints_excitation.yaml')]
    assert main([*arguments, '--validation']) == 0
    best = TrajectoryFile.load(out)
    assert best.made_with['scaled_condition_number'] > 1.0
    assert best.periods == 5
    assert {'torque', 'self clearance', 'ground clearance'} <= set(best.made_with['margins'])
    slow, fast = (
        TrajectoryFile.load(tmp_path / f'best_validation_{name}.yaml') for name in ('slow', 'fast')
    )
    assert (slow.trajectory.f0, fast.trajectory.f0) == (0.125, 0.5)
    assert (slow.periods, fast.periods) == (2, 10)
    printed = capsys.readouterr().out
    assert 'start 0' in printed
    assert 'times smaller than those of the random trajectory above (geometric mean)' in printed
    assert 'motor current' in printed
    assert not list(tmp_path.glob('*.tmp'))


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--fundamental', '0.07'], 'pass 14.2857 s or 28.5714 s'),
        (['--duration', '4'], 'pass 10 s'),
        (['--harmonics', '200'], 'highest_frequency of the excitation configuration'),
        (['--harmonics', '0'], 'at least one harmonic'),
        (['--bias', '0', '-0.4', '0', '0'], '(bias) is infeasible: ground clearance of link4'),
        (['--bias', '0', '0'], 'bias has 2 values'),
        (['--out', '/nowhere/best.yaml'], '/nowhere/best.yaml cannot be written'),
        (['--out', '/tmp'], 'is a folder'),
        (['--amplitude', '100'], 'all of the amplitude 100 rad is feasible'),
        (['--time-limit', '1e-6'], 'so it wrote no files'),
        (['--acceleration-limit', '3'], 'acceleration_limit cannot be combined with'),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, capsys, arguments, message) -> None:
    assert main([*SMALL, '--out', str(tmp_path / 'best.yaml'), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_nothing_is_written_if_a_validation_trajectory_is_infeasible(
    tmp_path: Path, capsys
) -> None:
    settings = tmp_path / 'excitation.yaml'
    settings.write_text('bias: [0.0, 1.5708, 0.0, 0.0]\nhighest_frequency: 0.3\n')
    arguments = ['--harmonics', '1', '--fundamental', '0.2', '--duration', '20', '--validation']
    arguments += ['--excitation-config', str(settings), '--out', str(tmp_path / 'best.yaml')]
    assert main(arguments) == 2
    assert 'fast validation trajectory: the highest harmonic' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [settings]


@pytest.mark.parametrize('arguments', [['--duration', 'inf'], ['--starts', '0'], ['--nonsense']])
def test_a_wrong_argument_is_one_line(tmp_path: Path, capsys, arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match='2'):
        main(['--out', str(tmp_path / 'best.yaml'), *arguments])
    error = capsys.readouterr().err
    assert error.startswith('excitation_designer: ') and arguments[0] in error
    assert error.endswith('; see excitation_designer --help\n')
    assert error.count('\n') == 1


@pytest.mark.parametrize('name', ['best.yaml', 'best_validation_slow.yaml'])
def test_files_that_exist_are_replaced_on_request_only(tmp_path: Path, capsys, name: str) -> None:
    (tmp_path / name).write_text('mine')
    arguments = [*SMALL, '--out', str(tmp_path / 'best.yaml'), '--validation']
    assert main(arguments) == 2
    assert f'/{name} already exists: name another file with --out, or pass --overwrite' in (
        capsys.readouterr().err
    )
    assert [path.read_text() for path in tmp_path.iterdir()] == ['mine']
    # The trial of the folder is the same with it; the search itself is left out.
    assert main([*arguments, '--overwrite', '--time-limit', '1e-6']) == 2
    assert 'so it wrote no files' in capsys.readouterr().err


def test_another_arm_by_the_defaults(
    tmp_path: Path, capsys, example_urdf: Callable[[str], Path]
) -> None:
    out = tmp_path / 'best.yaml'
    arguments = ['--urdf', str(example_urdf('panda.urdf')), '--starts', '1']
    arguments += ['--locked', 'panda_finger_joint1', 'panda_finger_joint2']
    arguments += ['--acceleration-limit', '10', '--out', str(out)]
    # A busy host may need more than the first.
    limits = ('4', '30', '400')
    assert any(main([*arguments, '--time-limit', limit]) == 0 for limit in limits)
    best = TrajectoryFile.load(out)
    assert best.made_with['margins']['acceleration']['allowed'] == 9.0
    printed = capsys.readouterr().out
    assert 'exceeds its limit of 26 (--condition-limit); ' in printed
    assert 'the limit of motor current' in printed
    assert 'close together by design' in printed


def test_a_stop_before_there_is_anything_is_one_line(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C as soon as the handlers are set, before the first slow import."""
    enter = StopSignals.__enter__

    def interrupted(self: StopSignals) -> StopSignals:
        entered = enter(self)
        signal.raise_signal(signal.SIGINT)
        return entered

    monkeypatch.setattr(StopSignals, '__enter__', interrupted)
    assert main(['--out', str(tmp_path / 'best.yaml')]) == 130
    assert capsys.readouterr().err == (
        'excitation_designer: the user stopped the search before the designer found a feasible '
        'trajectory, so it wrote no files: pass a larger --time-limit or a smaller --amplitude\n'
    )
    assert not list(tmp_path.iterdir())


def test_a_stop_keeps_the_best_so_far(tmp_path: Path, capsys) -> None:
    out = tmp_path / 'best.yaml'

    def stop() -> None:
        while not out.exists():
            time.sleep(0.05)
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=stop, daemon=True).start()
    assert main(['--out', str(out), '--starts', '1000', '--workers', '1', *PATIENT]) == 0
    assert 'the user stopped the search; the output file contains the best' in (
        capsys.readouterr().out
    )
    assert TrajectoryFile.load(out).joint_names == ('joint1', 'joint2', 'joint3', 'joint4')
