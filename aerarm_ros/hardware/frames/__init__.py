"""Layout, encoding and decoding of the 34-byte SPI frames that bridge and boards exchange.

A frame profile (a YAML file) defines the layout. Encoding converts a board command into a frame.
Decoding converts a frame into a board state, or into None if the checksum of the frame is wrong.
"""
