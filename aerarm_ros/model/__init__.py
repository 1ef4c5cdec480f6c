"""What the arm does: the equations of motion and all that is linear in their parameters.

In come positions, velocities and accelerations of the joints; out go frames, torques, inertia,
gravity, the regressor of the thesis, and the same of arm and carrier as one body. Pinocchio
computes; rotors, gears and friction are ours.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'cross_product': ['cross'],
        'drive_train': ['DriveTrain'],
        'dynamics': ['Dynamics', 'checked_rotor_inertia'],
        'friction': ['viscous_coulomb'],
        'gravity_load': ['largest_gravity_load'],
        'inertia': [
            'barycentric_inertia',
            'checked_body',
            'from_pseudo_inertia',
            'inertia_about_origin',
            'is_physically_consistent',
            'joined',
            'minimum_eigenvalue',
            'parameters_of_body',
            'pseudo_inertia',
        ],
        'kinematics': ['Kinematics', 'dh_forward', 'dh_transform'],
        'last_link': ['LastLink', 'checked_payload'],
        'momentum_regressor': ['MomentumRegressor'],
        'regressor': ['Regressor'],
        'whole_body_dynamics': ['WholeBodyDynamics'],
    },
)
