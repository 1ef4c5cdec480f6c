"""What is identified: the parameters of links and joints, named, and what is known of them before.

In come the arm's description and what the user knows of it; out go the terms of each joint's
torque, the order and the names of all parameters, their values by CAD and bounds on them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_parameters': ['ArmParameters'],
        'coupled_joints': ['CoupledJoints', 'coupled_terms'],
        'inertia_boxes': ['InertiaBoxes'],
        'joint_model': ['JointModel'],
        'joint_term': ['COUPLED', 'JointTerm', 'ROTOR', 'THESIS_TERMS', 'TermKind'],
        'link_bounds': ['LinkBounds'],
    },
)
