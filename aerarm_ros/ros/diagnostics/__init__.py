"""What people are told while something works: on /diagnostics, in the log, on the terminal.

In come numbers and problems, as often as there are any; the same go out as often as a person reads.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'diagnostics_publisher': ['DiagnosticsPublisher'],
        'progress_line': ['ProgressLine'],
        'sentences': ['followed_by'],
        'waiting_notice': ['WaitingNotice'],
    },
)
