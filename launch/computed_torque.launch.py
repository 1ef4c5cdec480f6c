"""Start the bridge and computed_torque, which follows joint trajectories, thesis (2.21).

ros2 launch aerarm_ros computed_torque.launch.py enable:=true view:=true

Accepts the arguments of bringup.launch.py.
"""

from launch import LaunchDescription

from aerarm_ros.launch_parts import bringup, controller_argument


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    return LaunchDescription([controller_argument('computed_torque'), bringup()])
