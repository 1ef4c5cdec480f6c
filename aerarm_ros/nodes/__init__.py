"""Executables of this ROS package, one per file.

- boards and arm: `hardware_bridge`, `fake_hardware` (emulated boards), `arm` (requests)
- controllers: `nodes.controllers`
- drone: `px4_imu` (IMU of PX4), `base_reaction` (reaction of the arm on the drone),
  `mavlink_feedforward`, `px4_feedforward`, `mavros_feedforward` (feed-forward to the autopilot),
  `flight_control`
- two computers: `ground_link`
- contact and payload: `contact_estimator`, `payload_estimator`
- optimal motions: `motion_planner`
- identification and calibration: `excitation_designer`, `excitation`, `recorder`, `identifier`,
  `motor_bench`, `calibrator`
- user interfaces: `view`, `tool_path`
- complete experiments: `demo`, `experiment`

The executables use the modules of `aerarm_ros.ros`; no other module imports an executable.
"""

import os

from aerarm_ros.realtime.scheduling import use_one_thread

use_one_thread()  # before an executable imports NumPy
# Executables draw nothing with MuJoCo. By default, importing MuJoCo starts a process that searches
# for a window library; a stop signal in this time would print a traceback.
os.environ.setdefault('MUJOCO_GL', 'disable')
