"""What a user need not choose: filter, where gravity points, and which friction each joint has.

In come recordings or samples; out go the filter with the least torque error and the terms that
predict held-out motion best, each with what else was tried.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bag_weights': ['weighted_bags'],
        'cross_validation': ['CrossValidation'],
        'effort_delay': ['EffortDelay', 'find_effort_delay'],
        'filter_choice': ['FilterChoice', 'FilterTrial', 'choose_filter', 'condition_once'],
        'gravity_direction': ['GravityDirection', 'find_gravity'],
        'joint_model_selection': ['Comparison', 'candidate_terms', 'select_terms'],
        'model_choice': ['AUTOMATIC', 'FRICTION_MODELS', 'choose_model', 'friction_terms'],
    },
)
