"""ROS 2 suite for a light four-joint arm that hangs under a drone.

For Python programs with any serial arm, the package offers `read_bag`, `from_arrays`, `identify`,
`plan_excitation`, `load_identified`, `load_robot` and `Dynamics`; see `docs/reference/python.md`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'description.config_reader': ['ConfigError', 'DescriptionError'],
        'description.robot': ['load_robot'],
        'excitation.settings': ['ExcitationError'],
        'model.dynamics': ['Dynamics'],
        'ros.library.excitation': ['plan_excitation', 'PlannedExcitation'],
        'ros.library.identification': [
            'identify',
            'IdentifiedArm',
            'IdentifiedModel',
            'load_identified',
            'BagError',
            'from_arrays',
            'read_bag',
        ],
        'identification.conditioning.motion_check': ['ConditioningOptions'],
        'identification.identify': ['IdentificationOptions'],
        'identification.joint_model': ['LinkBounds'],
        'identification.errors': ['IdentificationError'],
    },
)
