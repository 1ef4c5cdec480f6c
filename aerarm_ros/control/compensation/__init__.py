"""Against what a model of rigid links does not explain.

In come velocities, errors and measured torques; out go torques or accelerations that a law or
the loop adds: friction, the integral of an error, the disturbance that is observed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'error_integral': ['ErrorIntegral'],
        'fade': ['Fade'],
        'friction_compensation': ['FrictionCompensation'],
        'momentum_observer': ['MomentumObserver'],
    },
)
