"""What the larger programs do once their command line is read: each run is an object.

In come options of `identifier`, `payload_estimator --bag`, `excitation_designer`, `demo` or
`arm init`; out go files, and text for a terminal.
"""
