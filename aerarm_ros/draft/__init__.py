"""A first configuration of an arm that nobody has described yet, but for its URDF.

In comes a robot; out go its drive train and what an excitation may do, as YAML with a mark at every
value that no URDF knows, and a sentence on how to find it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_draft': ['ArmDraft'],
        'draft_text': ['arm_text', 'excitation_text'],
        'drive_draft': ['DriveDraft'],
        'gains_draft': ['draft_gains'],
        'rest_posture': ['RestPosture'],
    },
)
