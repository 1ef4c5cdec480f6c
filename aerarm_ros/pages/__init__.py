"""The look of every report: one template, one theme of plots, one file that needs no network.

In come titles, texts, tables and figures of the rooms that have something to tell; out goes a page,
light or dark as its reader likes, with what it was made of and how at its top.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
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
        'page_origin': ['origin'],
        'plots': ['figure_html', 'plain_text', 'plotly_figure', 'plotting_script'],
    },
)
