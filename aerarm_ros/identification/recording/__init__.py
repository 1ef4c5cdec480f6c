"""What a bag says of an arm's motion, and which part of it can be trusted.

In come joint states as a bag reader returns them; out go recordings: checked, with joints in the
arm's order, cut to the stretch in which the arm follows commands, without the messages whose
stamps or efforts tell nothing. A recording that can't be used is an `IdentificationError`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bag_facts': ['BagFacts'],
        'desired_velocity': ['DesiredVelocity'],
        'faulty_effort': ['saturated_effort', 'without_spikes'],
        'identification_error': ['IdentificationError'],
        'recording': ['JointMapping', 'JointStates', 'Recording', 'recording_from_states'],
        'stamps': ['check_stamp_unit', 'sound_messages'],
        'table_column': ['TableColumn'],
        'table_file': ['TABLES', 'TableOptions', 'TableStates', 'read_table'],
        'units': ['check_units'],
        'used_span': ['RUNNING', 'UsedSpan', 'commanded_span', 'moving_span', 'running_span'],
    },
)
