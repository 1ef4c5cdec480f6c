"""Compare controllers on the simulated arm, as in section 5.4 of the thesis.

ros2 launch aerarm_ros experiment.launch.py out:=controllers identified:=run1/identified.urdf

The experiment prints a table and writes an HTML page. It needs neither bridge nor motors.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import ExecutableInPackage

from aerarm_ros.launch_parts import after, check_first, end

ARGUMENTS = (
    DeclareLaunchArgument(
        'out', default_value='experiment', description='folder for the HTML page with results'
    ),
    DeclareLaunchArgument('seed', default_value='1', description='seed of the random trajectory'),
    DeclareLaunchArgument(
        'identified',
        default_value='',
        description='URDF of the arm to simulate, for example identified.urdf (empty: an arm with '
        'random parameters)',
    ),
    DeclareLaunchArgument(
        'only',
        default_value='',
        description='run only the cases of the experiment whose name contains this text',
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    options = [
        part
        for argument in ARGUMENTS
        for part in (f'--{argument.name}', LaunchConfiguration(argument.name))
    ]
    experiment = ExecuteProcess(
        cmd=[ExecutableInPackage(package='aerarm_ros', executable='experiment'), *options],
        output='screen',
    )
    done = end('the experiment has ended')
    return LaunchDescription(
        [*ARGUMENTS, check_first(), experiment, after(experiment, 'experiment', done)]
    )
