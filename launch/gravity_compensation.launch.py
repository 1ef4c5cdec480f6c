"""Start the bridge and the controller gravity_compensation, which holds the arm at set points.

ros2 launch aerarm_ros gravity_compensation.launch.py enable:=true view:=true

Accepts the arguments of bringup.launch.py.
"""

from launch import LaunchDescription

from aerarm_ros.launch_parts import bringup, controller_argument


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    return LaunchDescription([controller_argument('gravity_compensation'), bringup()])
