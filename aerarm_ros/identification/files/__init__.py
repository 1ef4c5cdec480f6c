"""A result as files: estimates as YAML that nodes read, the URDF, numbers for other programs.

In comes an identification's result; out goes text, and a folder that is there whole or not at
all. An estimate can be read back.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bench_comparison': ['compare_benches'],
        'estimate_comparison': ['EstimateComparison', 'compare_estimates'],
        'estimate_file': ['estimate_yaml', 'payload_yaml'],
        'estimate_reader': ['read_estimate', 'read_gravity'],
        'friction_torque': ['FrictionDeviations', 'friction_deviations'],
        'identified_urdf': ['IdentifiedUrdf'],
        'result_directory': ['MARKER', 'ResultDirectory'],
        'summary': ['summarise', 'term_text'],
    },
)
