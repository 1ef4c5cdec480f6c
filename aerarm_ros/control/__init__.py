"""Control of the arm, without ROS: (state, reference, dt) -> command.

In come measured states, IMU samples and what users and planners ask for; out goes one
`JointCommand` for every state. The rooms, in the order of their imports:

- checks: limits, gains and other numbers are refused before they do harm
- base: how the drone moves the arm's base, and the arm the drone
- references: what to follow, from trajectories, set points and streams
- compensation: friction, steady errors and unknown forces
- laws: one control law a file

`ControlLoop` puts one of each together into a cycle.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=['checks', 'base', 'references', 'compensation', 'laws'],
    submod_attrs={
        'control_loop': ['ControlLoop'],
        'checks.joint_limits': ['JointLimits'],
        'checks.rejected_input_error': ['RejectedInputError'],
        'base.base_motion': ['BaseMotion'],
        'base.base_motion_estimator': ['BaseMotionEstimator'],
        'base.base_reaction': ['BaseReaction'],
        'base.imu_sample': ['ImuSample'],
        'base.moving_base_dynamics': ['MovingBaseDynamics'],
        'references.target_follower': ['TargetFollower'],
        'references.trajectory_follower': ['TrajectoryFollower'],
        'compensation.friction_compensation': ['FrictionCompensation'],
        'compensation.momentum_observer': ['MomentumObserver'],
        'laws.board_computed_torque': ['BoardComputedTorque'],
        'laws.cartesian_impedance': ['CartesianImpedance'],
        'laws.cartesian_motion_control': ['CartesianMotionControl'],
        'laws.computed_torque': ['ComputedTorque'],
        'laws.gravity_compensation': ['GravityCompensation'],
        'laws.joint_motion_control': ['JointMotionControl'],
    },
)
