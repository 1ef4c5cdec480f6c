"""Controllers compared on the simulated arm, thesis 5.4: the whole stack but ROS.

In come an arm, a motion and the parameters of the plant; out goes one run a case, the same every
time, and a page with the errors of all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'experiment_bench': ['ExperimentBench', 'ExperimentRun'],
        'experiment_case': ['ExperimentCase', 'all_cases'],
        'experiment_report': ['ExperimentReport'],
        'parallel_runs': ['run_all'],
    },
)
