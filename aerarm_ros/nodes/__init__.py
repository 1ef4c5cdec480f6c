"""The executables, one per file.

- the boards and the arm: `hardware_bridge`, `fake_hardware` (emulated boards), `arm` (requests)
- the controllers: `nodes.controllers`
- the drone: `px4_imu` (the drone's motion), `base_reaction` (the arm's reaction on the drone),
  `mavlink_feedforward`, `px4_feedforward`, `mavros_feedforward` (feedforward to the autopilot),
  `flight_control`
- two hosts: `ground_link`
- contact and payload: `contact_estimator`, `payload_estimator`
- optimal motions: `motion_planner`
- identification: `excitation_designer`, `excitation`, `recorder`, `identifier`, `motor_bench`,
  `calibrator`
- user interfaces: `view`, `tool_path`
- a whole experiment in one command: `demo`, `experiment`

The executables are built from `aerarm_ros.ros`; no other module imports an executable.
"""

import os

from aerarm_ros.realtime.scheduling import use_one_thread

use_one_thread()  # before an executable imports NumPy
# Executables draw nothing with MuJoCo. By default its import runs a process that looks for a
# window library, which prints a traceback if a stop signal ends the executable meanwhile.
os.environ.setdefault('MUJOCO_GL', 'disable')
