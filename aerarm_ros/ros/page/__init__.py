"""Web page of the node `view`, on which the user sees and moves the arm.

The page draws the moving arm, plots, and tables of diagnostics. Its buttons send requests to the
bridge and goals to the running controller, and start a recorder, a player or a controller. The
server rejects requests that come from other web sites or lack the secret token.
"""
