"""Clients that call the bridge's services, publish set points or set another node's parameters.

Each request returns the answer, or raises `ArmClientError` with advice. A stop request goes to
every bridge, and any other request goes to one bridge only.
"""
