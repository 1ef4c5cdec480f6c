"""ROS 2 suite for a light four-joint arm that hangs under a drone.

From Python, for any serial arm: `read_bag`, `from_arrays`, `identify`, `plan_excitation`,
`load_robot` and `Dynamics`; `docs/reference/python.md` shows them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'description.config_error': ['ConfigError'],
        'description.description_error': ['DescriptionError'],
        'description.robot': ['load_robot'],
        'excitation.settings.excitation_error': ['ExcitationError'],
        'model.dynamics': ['Dynamics'],
        'ros.library.excitation': ['plan_excitation'],
        'ros.library.identification': ['identify'],
        'identification.conditioning.conditioning_options': ['ConditioningOptions'],
        'identification.identify': ['IdentificationOptions'],
        'identification.parameters.link_bounds': ['LinkBounds'],
        'identification.recording.identification_error': ['IdentificationError'],
        'ros.library.identified_arm': ['IdentifiedArm'],
        'ros.library.motions': ['BagError', 'from_arrays', 'read_bag'],
        'ros.library.planned_excitation': ['PlannedExcitation'],
    },
)
