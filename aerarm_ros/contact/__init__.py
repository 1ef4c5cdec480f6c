"""What touches drone or arm in flight.

In come odometry, commands of the rotors and joint states, and the model of drone and arm; out goes
the wrench of whatever else acts on them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'contact_estimator': ['ContactEstimator'],
        'contact_observer': ['ContactObserver'],
        'contact_zero': ['ContactZero'],
    },
)
