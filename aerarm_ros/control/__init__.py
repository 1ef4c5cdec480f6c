"""Controllers of the arm, which compute joint commands from states and references, without ROS.

A controller receives measured states, IMU samples, and references of users and planners. A
controller returns one `JointCommand` per state. The packages, in the order of their imports:

- checks: reject invalid limits, gains and other numbers
- base: motion of the arm's base by the drone, and wrench of the arm on the drone
- references: references from trajectories, set points and streams
- compensation: friction, steady errors and unknown forces
- laws: one control law per file

`ControlLoop` combines one of each into a cycle.
"""
