"""What one node asks of another: services of the bridge, a set point, a parameter.

In come a node and a wish; out goes what came of it, or an `ArmClientError` that says what to
check. Who answers is found first: a stop goes to every bridge, all else only to one.
"""
