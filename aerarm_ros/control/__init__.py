"""Control of the arm, without ROS: (state, reference, dt) -> command.

In come measured states, IMU samples and what users and planners ask for; out goes one
`JointCommand` for every state. The rooms, in the order of their imports:

- checks: limits, gains and other numbers are refused before they do harm
- base: how the drone moves the arm's base, and the arm the drone
- references: what to follow, from trajectories, set points and streams
- compensation: friction, steady errors and unknown forces
- laws: one control law a file

`ControlLoop` puts one of each together into a cycle.
"""
