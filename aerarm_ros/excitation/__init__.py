"""Excitation trajectories for identification: design, checks, planning and playback.

The inputs are an arm's description, `config/excitation.yaml` and the parameters to identify. The
results are trajectory files, preview pages, and commands that play a motion. The modules, in the
order of their imports:

- settings: usable limits of the arm, and its surroundings
- trajectory: classes of motions
- clearance: distances between links, and to the ground
- feasibility: margins of a motion to all limits
- excitation_setup: motion from the present posture through a trajectory and back
- trajectory_designer: optimal trajectories for identification
- player: commands that follow a motion, given measured states
- preview: page that shows a motion
"""
