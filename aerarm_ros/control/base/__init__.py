"""The base of the arm in motion: what the drone does to the arm, and the arm to the drone.

In come IMU samples in the autopilot's or ROS's frames, and commands of the rotors; out goes a
`BaseMotion` at any time near now, the arm's dynamics on such a base, and
the wrench of the arm on what carries it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'acceleration_estimate': ['AccelerationEstimate'],
        'base_motion': ['BaseMotion'],
        'base_motion_estimator': ['BaseMotionEstimator'],
        'base_motion_prediction': ['BaseMotionPrediction'],
        'base_reaction': ['BaseReaction'],
        'answer_correction': ['AnswerCorrection'],
        'drone_in_base': ['carrier_parameters', 'wrench_per_thrust'],
        'feedback_check': ['check_feedback', 'largest_delay', 'largest_feedback_gain'],
        'free_base_estimator': ['FreeBaseEstimator'],
        'free_base_motion': ['FreeBaseMotion'],
        'frame_conversion': [
            'frd_to_flu',
            'attitude_ned_frd_to_enu_flu',
            'quaternion_product',
            'rotation_matrix',
            'quaternion',
        ],
        'imu_sample': ['ImuSample'],
        'imu_watch': ['ImuWatch'],
        'mount': ['Mount'],
        'moving_base_dynamics': ['MovingBaseDynamics'],
        'oscillation_watch': ['OscillationWatch'],
        'rotor_wrench': ['RotorWrench'],
    },
)
