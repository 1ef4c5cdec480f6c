"""What a filter calls itself in the report."""

from aerarm_ros.identification.conditioning.uniform_motion import KinematicsFilter


def test_labels() -> None:
    assert KinematicsFilter(5.0, 5).label == (
        'rectangular windows at 5 harmonics, measured velocities'
    )
    assert KinematicsFilter(4.25, None, True).label == (
        'zero-phase Butterworth at 4.25 Hz, differentiated positions'
    )
