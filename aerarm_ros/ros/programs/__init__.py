"""What the larger programs do once their command line is read: each run is an object.

In come options of `identifier`, `payload_estimator --bag`, `excitation_designer`, `demo` or
`arm init`; out go files, and text for a terminal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'commissioning_run': ['CommissioningRun'],
        'demo_account': ['DemoAccount'],
        'demo_run': ['DemoError', 'DemoRun'],
        'design_options': ['excitation_setup', 'torque_noise', 'whole_periods'],
        'design_run': ['DesignRun'],
        'friction_table': ['show_trend', 'trend_table'],
        'identifier_bags': ['IdentifierBags', 'RecordedBag', 'bag_names', 'repeated_bags'],
        'identifier_compare': ['CompareRun'],
        'identifier_files': ['RESULT_FILES', 'write_result'],
        'identifier_options': ['identifier_parser'],
        'identifier_payload': ['PayloadRun'],
        'identifier_run': ['IdentifierRun'],
        'identifier_table': ['terminal_table'],
        'init_run': ['InitRun'],
        'payload_replay': ['PayloadReplay'],
        'recorded_arm': ['RecordedArm'],
    },
)
