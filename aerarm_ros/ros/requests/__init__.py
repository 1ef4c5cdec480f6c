"""Requests from one node to another: services of the bridge, set points, parameters.

Each request returns the answer, or raises `ArmClientError` with advice. A stop goes to every
bridge, any other request to one bridge only.
"""
