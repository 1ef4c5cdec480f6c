"""The arm in a browser.

In come states, diagnostics and what a person presses; out go a moving picture, plots and tables,
requests to the bridge, motions for the controller that runs, and programs that record, play and
control. Other sites and strangers are refused before anything is served.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'child_program': ['ChildProgram'],
        'page_commissioning': ['PageCommissioning'],
        'page_dress': ['dress'],
        'page_guard': ['PageGuard', 'is_loopback'],
        'page_messages': ['is_allowed'],
        'page_motion': ['PageMotion'],
        'page_programs': ['PageProgramError', 'PagePrograms'],
        'page_requests': ['PageRequests'],
        'page_server': ['PageError', 'serve_page'],
        'view_commissioning': ['ViewCommissioning'],
        'view_controls': ['ViewControls'],
        'view_diagnostics': ['ViewDiagnostics', 'ViewStatus', 'timing_rows'],
        'view_feed': ['ViewFeed'],
        'view_history': ['ViewHistory'],
        'view_panel': ['ViewPanel'],
        'view_plots': ['ViewPlots'],
        'view_scene': ['ViewScene'],
    },
)
