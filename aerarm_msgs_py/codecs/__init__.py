"""Conversion of serialized messages (CDR) to numbers and back.

The input is one message, or many messages in one buffer; the results are stamps and arrays. Numbers
of messages with a known layout are read and written at fixed offsets, those of other messages field
by field.
"""
