"""The vocabulary of motion that control laws, excitations and the bridge share.

In come postures, velocities and times as plain numbers; out go references, states and commands
in the thesis's symbols (q, dq, ddq, tau), and the polynomials that lead from one to the next.
Nothing here knows an arm, a limit or a message.
"""

import lazy_loader

# What is named as its module is imported from there.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_state': ['ArmState'],
        'float_array': ['FloatArray'],
        'joint_command': ['JointCommand'],
        'joint_motion': ['JointMotion'],
        'joint_reference': ['JointReference'],
        'joint_brake': ['JointBrake', 'brake'],
        'path_stop': ['PathStop', 'PathTime', 'stop_along'],
        'polynomial_path': ['PolynomialPath'],
        'smooth_step': ['SmoothStep', 'rest_to_rest_duration'],
        'task_reference': ['TaskReference'],
    },
)
