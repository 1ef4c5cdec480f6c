"""The arm in a browser.

In come states and diagnostics; out go a moving picture, plots, tables, and the presses of the
stop button. Other sites and strangers are refused before anything is served.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'page_guard': ['PageGuard', 'is_loopback'],
        'page_messages': ['is_allowed'],
        'page_server': ['PageError', 'serve_page'],
        'view_diagnostics': ['ViewDiagnostics', 'ViewStatus', 'timing_rows'],
        'view_history': ['ViewHistory'],
        'view_panel': ['ViewPanel'],
        'view_scene': ['ViewScene'],
    },
)
