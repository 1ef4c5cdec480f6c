"""What a bag says of an arm's motion, and which part of it can be trusted.

In come joint states as a bag reader returns them; out go recordings: checked, with joints in the
arm's order, cut to the stretch in which the arm follows commands, without the messages whose
stamps or efforts tell nothing. A recording that can't be used is an `IdentificationError`.
"""
