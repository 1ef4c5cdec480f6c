"""The first power-on of an arm: which motor turns which joint, which way, by which gear, how well.

In come the bridge's reports and a person's answers; out go prompts, requests to the bridge, what
was found, and a record beside the configuration. `Commissioning` is the entry point.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'commissioning': ['Commissioning'],
        'commissioning_record': ['CommissioningRecord', 'JointRecord', 'load_record'],
        'commissioning_step': ['BoardStep', 'CommissioningStep', 'DriveStep', 'Prompt', 'TurnStep'],
        'joint_verdicts': ['drive_findings', 'return_findings', 'turn_findings'],
    },
)
