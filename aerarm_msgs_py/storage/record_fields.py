"""The fields of a binary record, one after another."""


class RecordFields:
    """Cursor over the content of one little-endian record.

    Every method raises ValueError if the record ends too early or holds no text where one
    should be.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self.position = 0

    @property
    def left(self) -> int:
        """Bytes behind the cursor."""
        return len(self._content) - self.position

    def number(self, size: int) -> int:
        """Read an unsigned number of some bytes."""
        return int.from_bytes(self.take(size), 'little')

    def text(self) -> str:
        """Read a length of 4 bytes and that much UTF-8."""
        return self.take(self.number(4)).decode()

    def take(self, size: int) -> bytes:
        """Read bytes."""
        if size > self.left:
            raise ValueError(f'it ends {size - self.left} bytes too early')
        self.position += size
        return self._content[self.position - size : self.position]
