"""The motor boards as the bridge drives them, and what it makes of their answers.

In come limited commands and the boards' frames; out go motor references in frames, the joints'
positions, velocities and torques, the motors' power, and the faults of boards and encoders.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_measurements': ['ArmMeasurements'],
        'board_link': ['BoardLink', 'make_links'],
        'board_mode': ['BoardMode'],
        'board_monitor': ['BoardMonitor'],
        'commissioning_probe': ['CommissioningProbe'],
        'encoder_monitor': ['EncoderMonitor'],
        'encoder_zeros': ['EncoderZeros'],
        'expected_motion': ['ExpectedMotion'],
        'homing': ['Homing'],
        'motor_power': ['MotorPower'],
        'motor_reference': ['MotorReference'],
        'motor_references': ['MotorReferences'],
        'probe_messages': ['ProbeReport', 'ProbeRequest', 'Stroke'],
        'reported_resistance': ['resistance_by_boards'],
        'restart_watch': ['RestartWatch'],
        'spi_self_test': ['self_test'],
        'zero_search': ['ZeroSearch'],
    },
)
