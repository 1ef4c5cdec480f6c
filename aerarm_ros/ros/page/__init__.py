"""Web page of the arm.

The page shows states and diagnostics as a moving picture, plots and tables. Buttons send requests
to the bridge, send motions to the running controller, and start programs that record, play and
control. Requests from other sites and without a token are rejected first.
"""
