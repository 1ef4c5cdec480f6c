"""Whether a motion keeps every limit, and by how much.

In come a motion, limits, clearance and the torques a prior model expects; out goes a
`FeasibilityReport` with the margin to each limit, rest anywhere on the way included.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'effort_model': ['EffortModel'],
        'feasibility_checker': ['FeasibilityChecker'],
        'feasibility_report': ['LimitMargin', 'peak_margins', 'FeasibilityReport'],
        'stop_limits': ['StopLimits'],
    },
)
