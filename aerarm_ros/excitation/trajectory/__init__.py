"""The motions themselves, each a function of time that starts and ends at rest.

In come coefficients, postures and durations; out goes a `JointReference` at any time, or at many.
No limit is known here.
"""

import lazy_loader

# What is named as its module is imported from there.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'fourier_trajectory': ['FourierTrajectory'],
        'motion_sequence': ['Stage', 'MotionSequence'],
        'ramped_excitation': ['RampedExcitation'],
        'steady_stroke': ['SteadyStroke'],
        'transfer': ['standstill'],
    },
)
