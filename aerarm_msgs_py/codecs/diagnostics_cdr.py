"""Serialized diagnostic_msgs/DiagnosticArray, as far as the suite reads it back."""

from aerarm_msgs_py.codecs.cdr_reader import CdrReader


def diagnostic_values(payload: bytes) -> dict[str, dict[str, str]]:
    """Return the values of each status by its name.

    Raises
    ------
    ValueError
        If the payload is no DiagnosticArray.
    """
    reader = CdrReader(payload)
    reader.int32(), reader.uint32(), reader.string()  # header
    found: dict[str, dict[str, str]] = {}
    for _ in range(reader.uint32()):
        reader.octet()  # level
        name = reader.string()
        reader.string(), reader.string()  # message, hardware
        found[name] = {reader.string(): reader.string() for _ in range(reader.uint32())}
    return found
