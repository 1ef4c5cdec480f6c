"""A result as one HTML page that needs nothing else to be read.

In come an identification's result and what is known besides; out goes the page, made of the pieces
that `pages` has for all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'figure': ['StackedFigure'],
        'report': ['ReportExtras', 'report_html'],
        'residual_spectrum': ['amplitude_density'],
    },
)
