"""What an excitation is given before anything is planned.

In come a YAML file, an arm's configuration or a URDF; out go the usable limits of its joints and
the surroundings, checked, or an `ExcitationError` that says what to change.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'excitation_config': ['ExcitationConfig', 'load_excitation_config'],
        'excitation_error': [
            'ExcitationError',
            'InfeasibleError',
            'NothingDrawnError',
            'DesignStoppedError',
        ],
        'motion_limits': ['one_a_joint', 'MotionLimits'],
    },
)
