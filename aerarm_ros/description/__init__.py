"""The arm as data, checked when it is read.

In come a URDF and YAML files; out go the robot, with its Pinocchio model and frames, and frozen
dataclasses of boards, motors, gears, joints and limits, and of the drone that carries it all. A
wrong file is one clear error.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_config': ['ArmConfig', 'load_arm_config'],
        'board_config': ['BoardConfig'],
        'config_error': ['ConfigError', 'check_choice', 'check_name', 'check_range'],
        'config_reader': ['build', 'check_keys', 'read_yaml', 'section'],
        'description_error': ['DescriptionError'],
        'drone_config': ['DroneConfig', 'load_drone_config'],
        'drone_urdf': ['with_drone'],
        'gear_config': ['GearConfig'],
        'joint_config': ['JointConfig'],
        'motor_config': ['MotorConfig', 'ThermalConfig', 'torque_constant'],
        'plain_yaml': ['plain_data', 'read_plain'],
        'pose_config': ['PoseConfig'],
        'power_stage_config': ['PowerStageConfig'],
        'resources': ['resource', 'share_directory'],
        'robot': ['Robot', 'load_robot'],
        'robot_shapes': ['load_shapes'],
        'rotor_config': ['RotorConfig'],
        'urdf_document': ['UrdfDocument', 'UrdfJoint'],
        'whole_file': ['write_whole'],
    },
)
