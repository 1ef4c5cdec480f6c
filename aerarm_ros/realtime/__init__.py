"""Time: loops with deadlines, and what they ask of the operating system.

In comes a function to call; out go calls on a grid of deadlines, or at the pace of an emulated
world, and statistics of how well that went.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'absolute_sleep': ['sleep_until'],
        'cycle_slack': ['CycleSlack'],
        'periodic_loop': ['PeriodicLoop'],
        'scheduling': [
            'freeze_garbage_collector',
            'keep_cpus_awake',
            'lock_memory',
            'set_affinity',
            'set_fifo',
        ],
        'steady_clock': ['SteadyClock'],
        'timing_assessment': ['TimingThresholds', 'assess_timing'],
        'timing_statistics': ['TimingStatistics'],
        'timing_summary': ['TimingSummary'],
        'world_loop': ['WorldLoop'],
    },
)
