"""What is given to a controller is checked here, before anything is changed.

In come gains, limits and references; the same go out as they were, or an error says what to give
instead: `ValueError` when a law is made, `RejectedInputError` while the arm is moved.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'gains': ['non_negative', 'finite', 'positive', 'non_negative_number'],
        'joint_limits': ['JointLimits'],
        'rejected_input_error': ['RejectedInputError'],
    },
)
