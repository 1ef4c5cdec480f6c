"""What an arm carries and how its gears wear, learnt while it works.

In come states of the arm, the motion of its base and the model of the arm without a payload; out
go, fifty times a second, a body that the last link carries, with standard deviations, and friction
as it is by now.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'change_test': ['ChangeTest'],
        'effort_watch': ['EffortWatch'],
        'estimator_settings': ['EstimatorSettings'],
        'filtered_motion': ['FilteredMotion', 'MotionRow'],
        'friction_trend': ['FrictionChange', 'FrictionRecord', 'FrictionTrend'],
        'information_filter': ['InformationFilter'],
        'known_arm': ['KnownArm'],
        'online_estimate': ['OnlineEstimate'],
        'payload_estimator': ['PayloadEstimator'],
        'payload_hand_over': ['PayloadHandOver'],
        'replay': ['LoadChange', 'Replay'],
        'trend_file': ['TrendFileError', 'read_trend', 'write_trend'],
    },
)
