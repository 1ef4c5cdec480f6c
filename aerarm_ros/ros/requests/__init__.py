"""Clients that call the bridge's services, publish set points or set another node's parameters.

Each request returns the answer, or raises `ArmClientError` with advice. A stop goes to every
bridge, any other request to one bridge only.
"""
