"""Excitation trajectories for identification: design, checks, planning and playback.

The inputs are an arm's description, `config/excitation.yaml` and the parameters to identify. The
results are trajectory files, and commands that play a motion. The modules, in the order of their
imports:

- settings: motion limits that an excitation may use, and surroundings of the arm
- trajectory: motions as functions of time (Fourier series, strokes, transfers)
- clearance: distances between links, and between links and ground
- feasibility: margins between a motion and all limits
- excitation_setup: motion from the present posture through a trajectory and back
- trajectory_designer: optimal trajectories for identification
- player: commands that follow a motion, given measured states
"""
