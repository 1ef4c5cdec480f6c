"""One drive at a time: friction, rotor inertia, torque constant, resistance (thesis 4.4).

In come runs in which a single joint moves; out go the drive's parameters with their uncertainty,
as YAML, as a configuration that has them, and as a report.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'motor_backlash': ['fit_backlash', 'is_told'],
        'motor_bench': ['Earlier', 'KnownMass', 'MotorBench'],
        'motor_files': ['bench_yaml', 'config_yaml', 'load_earlier'],
        'motor_friction': ['MotorFriction', 'fit_motor_friction'],
        'motor_inertia': ['fit_inertia'],
        'motor_report': ['bench_html', 'bench_table'],
        'motor_resistance': ['MotorResistance', 'find_resistance'],
        'motor_result': ['MotorResult'],
        'motor_run': ['MotorRun'],
        'motor_supply': ['MotorSupply'],
        'motor_torque_constant': ['fit_torque_constant'],
    },
)
