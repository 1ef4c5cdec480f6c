"""The arm in a browser.

In come states, diagnostics and what a person presses; out go a moving picture, plots and tables,
requests to the bridge, motions for the controller that runs, and programs that record, play and
control. Other sites and strangers are refused before anything is served.
"""
