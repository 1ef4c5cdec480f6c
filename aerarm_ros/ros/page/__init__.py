"""Web page of the node `view`, which shows the arm and controls it.

The page draws the moving arm, plots, and tables of diagnostics. Its buttons send requests to the
bridge and goals to the running controller, and start a recorder, a player or a controller. The
server rejects requests that come from other sites or lack the token.
"""
