"""What the arm shall follow at each instant.

In come checked trajectories, set points, streamed points and targets of the tool, each with its
time; out goes a `JointReference` or `TaskReference` every cycle, continuous whatever came.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'follower_tolerances': ['FollowerTolerances'],
        'goal_tolerances': ['resolve_tolerances'],
        'joint_trajectory': ['JointTrajectory'],
        'motion_end': ['MotionEnd'],
        'reference_source': ['ReferenceSource'],
        'streamed_point': ['Posture', 'StreamedPoint'],
        'target_follower': ['TargetFollower'],
        'trajectory_follower': ['TrajectoryFollower'],
        'transition': ['Transition', 'find_transition'],
        'trajectory_goals': ['GoalResult', 'ResultCode', 'TrajectoryGoals'],
    },
)
