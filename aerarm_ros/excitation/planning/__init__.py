"""From the posture the arm is in, through a motion, and back.

In come an arm with its settings (`ExcitationSetup`) and a trajectory, drawn at random or
designed, or the plan of a motor bench; out goes a feasible sequence of stages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bench_measurement': ['BenchMeasurement', 'split'],
        'bench_motion': ['BenchMotion', 'bench_checker'],
        'bench_plan': ['BenchPlan'],
        'excitation_planner': ['ExcitationPlanner'],
        'excitation_setup': ['ExcitationSetup'],
        'random_trajectory': ['RandomTrajectory'],
    },
)
