"""Serialized messages (CDR) to numbers and back.

In come the bytes of one message, or of many in one buffer; out go stamps and arrays. Messages of
a layout that is known are read and packed at fixed offsets, others field by field.
"""
