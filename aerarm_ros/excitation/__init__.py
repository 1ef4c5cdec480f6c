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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        'settings',
        'trajectory',
        'clearance',
        'feasibility',
        'planning',
        'design',
        'player',
        'preview',
    ],
    submod_attrs={
        'settings.excitation_config': ['ExcitationConfig', 'load_excitation_config'],
        'settings.excitation_error': ['ExcitationError', 'InfeasibleError'],
        'trajectory.fourier_trajectory': ['FourierTrajectory'],
        'trajectory.ramped_excitation': ['RampedExcitation'],
        'feasibility.feasibility_checker': ['FeasibilityChecker'],
        'feasibility.feasibility_report': ['FeasibilityReport'],
        'planning.bench_motion': ['BenchMotion'],
        'planning.bench_plan': ['BenchPlan'],
        'planning.excitation_planner': ['ExcitationPlanner'],
        'planning.excitation_setup': ['ExcitationSetup'],
        'planning.random_trajectory': ['RandomTrajectory'],
        'design.design_result': ['DesignResult'],
        'design.design_specification': ['DesignSpecification'],
        'design.parallel_design': ['design_all'],
        'design.trajectory_designer': ['TrajectoryDesigner'],
        'design.trajectory_file': ['TrajectoryFile'],
        'player.excitation_player': ['ExcitationPlayer'],
        'preview.preview': ['Preview'],
    },
)
