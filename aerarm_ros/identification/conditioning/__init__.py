"""From recordings to samples: a uniform grid, whole periods, filters, derivatives (thesis 3.5).

In come recordings and what the user says of their motion; out go samples of position, velocity,
acceleration and torque, and warnings where the motion is not what was said.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'conditioning': ['Conditioner'],
        'conditioning_options': ['ConditioningOptions', 'FILTERS'],
        'kinematics_filter': ['KinematicsFilter'],
        'periodicity': ['PeriodicPart', 'count_harmonics', 'find_periodic_part'],
        'samples': ['BLOCKS', 'FOLDS', 'Samples'],
        'signal_delays': ['SignalDelays'],
        'spectral_filter': ['SpectralFilter', 'harmonic_gain', 'low_pass_gain'],
        'uniform_motion': ['UniformMotion', 'aperiodic_motion', 'periodic_motion', 'sampling_time'],
    },
)
