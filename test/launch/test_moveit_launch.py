"""Settings of moveit.launch.py for move_group, without starting either."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

from aerarm_ros.description.resources import resource

FILE = Path(__file__).resolve().parents[2] / 'launch' / 'moveit.launch.py'
URDF = resource('urdf', 'aerarm.urdf')


@pytest.mark.skipif(
    find_spec('launch_ros') is None, reason='launch is not installed: it comes with ROS 2 from apt'
)
@pytest.mark.parametrize(
    ('given', 'takes_clock'),
    [
        ({}, True),
        ({'hardware': 'spi'}, False),
        ({'hardware': 'fake', 'use_sim_time': 'false'}, False),
    ],
)
def test_the_planner_has_the_time_of_the_states(given: dict[str, str], takes_clock: bool) -> None:
    from launch import LaunchContext

    file, context = runpy.run_path(str(FILE)), LaunchContext()
    context.launch_configurations.update(given)
    for argument in file['ARGUMENTS']:
        argument.execute(context)
    # As bringup.launch.py declares them.
    arm = {'hardware': 'fake', 'urdf': str(URDF), 'plant_urdf': str(URDF)}
    context.launch_configurations.update({**arm, **given})
    parameters = {k: v for part in file['_parameters'](context) for k, v in part.items()}
    assert parameters['use_sim_time'] is takes_clock
    assert parameters['robot_description'] == URDF.read_text()
    assert parameters['ompl']['arm']['default_planner_config'] == 'RRTConnect'
