"""One control law a file, and the inverse kinematics of those that need it.

In come the measured `ArmState`, a reference, the cycle's length and the motion of the base; out
goes a `JointCommand`. A law keeps what it integrates and nothing else.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'board_computed_torque': ['BoardComputedTorque'],
        'cartesian_impedance': ['CartesianImpedance'],
        'cartesian_motion_control': ['CartesianMotionControl'],
        'computed_torque': ['ComputedTorque'],
        'control_law': ['ControlLaw'],
        'damped_inverse': ['DampedInverse'],
        'gravity_compensation': ['GravityCompensation'],
        'inverse_dynamics_law': ['InverseDynamicsLaw'],
        'joint_motion_control': ['JointMotionControl'],
        'velocity_resolution': ['VelocityResolution'],
    },
)
