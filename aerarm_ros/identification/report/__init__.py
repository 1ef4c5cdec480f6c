"""A result as one HTML page that needs nothing else to be read.

In come an identification's result and what is known besides; out goes the page. Its pieces, text
that is escaped and figures drawn in the browser, serve other pages as well.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'figure': ['StackedFigure', 'figure_html', 'plain_text', 'plotting_script'],
        'html_text': [
            'Html',
            'bullets',
            'folded',
            'markup',
            'number',
            'page',
            'paragraph',
            'section',
            'table',
        ],
        'report': ['ReportExtras', 'report_html'],
        'residual_spectrum': ['amplitude_density'],
    },
)
