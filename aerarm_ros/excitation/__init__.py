"""Motions that make the arm's parameters visible: found, checked, planned and played.

In come an arm's description, `config/excitation.yaml` and what is to be identified; out go
trajectory files, pages to look at, and commands that play a motion. The rooms, in the order of
their imports:

- settings: what may be used of the arm and of the room about it
- trajectory: the motions themselves
- clearance: distances between the links, and to the ground
- feasibility: margins of a motion to every limit
- planning: from where the arm is through a motion and back
- design: trajectories that are best for the identification
- player: a motion against measured states
- preview: a motion as a page
"""
