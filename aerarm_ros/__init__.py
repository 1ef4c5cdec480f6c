"""ROS 2 suite for a light four-joint arm that hangs under a drone.

From Python, for any serial arm: `read_bag`, `from_arrays`, `identify`, `plan_excitation`,
`load_robot` and `Dynamics`; `docs/reference/python.md` shows them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'description.robot': ['load_robot'],
        'model.dynamics': ['Dynamics'],
        'ros.library.excitation': ['plan_excitation'],
        'ros.library.identification': ['identify'],
        'identification.identify': ['IdentificationOptions'],
        'ros.library.identified_arm': ['IdentifiedArm'],
        'ros.library.motions': ['from_arrays', 'read_bag'],
        'ros.library.planned_excitation': ['PlannedExcitation'],
    },
)
