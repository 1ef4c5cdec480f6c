"""The executables and nothing else, one a file: parameters -> pure object -> topics.

- the boards and the arm: `hardware_bridge`, `fake_hardware` (emulated boards), `arm` (requests)
- the controllers: `nodes.controllers`
- the drone: `px4_imu` (what it does to the arm), `base_reaction` (what the arm does to it),
  `px4_feedforward`, `mavros_feedforward` (what its autopilot is told of that), `flight_control`
- motions that cost little: `motion_planner`
- identification: `excitation_designer`, `excitation`, `recorder`, `identifier`, `motor_bench`
- for people: `view`, `tool_path`
- the whole in one command: `demo`, `experiment`

What they are made of is in `aerarm_ros.ros`; no other module imports an executable.
"""

from aerarm_ros.realtime.scheduling import use_one_thread

use_one_thread()  # an executable imports NumPy after this
