"""A body that the arm carries: mass, centre of mass and inertia (thesis 3.6).

In come recordings with the body and either an identification of the bare arm or an estimate that
was read back; out goes a `Payload`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'identify_payload': ['weigh_payload'],
        'payload': ['Payload'],
    },
)
