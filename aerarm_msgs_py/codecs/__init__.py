"""Conversion of serialized messages (CDR) to numbers and back.

The input is one message, or many in one buffer; the results are stamps and arrays. Messages with a
known layout are read and packed at fixed offsets, others field by field.
"""
