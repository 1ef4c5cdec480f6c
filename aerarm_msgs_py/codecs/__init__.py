"""Conversion between serialized messages (CDR) and numbers.

The decoders convert one message, or many messages in one buffer, into stamps and arrays. Messages
with a known layout are read and packed at fixed offsets, other messages field by field.
"""
