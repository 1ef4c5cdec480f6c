"""Start the bridge and the controller computed_torque, which follows joint trajectories.

ros2 launch aerarm_ros computed_torque.launch.py enable:=true view:=true

Accepts the arguments of bringup.launch.py.
"""

from launch import LaunchDescription

from aerarm_ros.launch_parts import bringup, controller_argument


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    return LaunchDescription([controller_argument('computed_torque'), bringup()])
