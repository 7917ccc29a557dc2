"""What others have written, made fit for a terminal."""

from collections.abc import Iterator
from typing import Final

_SHORT: Final = {'\\': '\\\\', '\n': '\\n', '\r': '\\r', '\t': '\\t'}
_ROW_BYTES: Final = 16


def escaped(text: str | bytes) -> str:
    """Write everything that is no visible character as an escape: it cannot steer a terminal."""
    if isinstance(text, bytes):
        text = text.decode(errors='surrogateescape')
    return ''.join(map(_escaped, text))


def _escaped(char: str) -> str:
    if char in _SHORT:
        return _SHORT[char]
    if char.isprintable():
        return char
    code = ord(char)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8
        return f'\\x{code - 0xDC00:02x}'
    if code <= 0xFF:
        return f'\\x{code:02x}'
    return f'\\u{code:04x}' if code <= 0xFFFF else f'\\U{code:08x}'


def shortened(text: str, chars: int) -> str:
    """Cut a text that is longer."""
    return text if len(text) <= chars else f'{text[: chars - 3]}...'


def text_lines(value: bytes) -> list[str] | None:
    """The lines of a text, escaped; None where the value is not UTF-8 or holds a NUL."""
    try:
        text = value.decode()
    except UnicodeDecodeError:
        return None
    return None if '\0' in text else [escaped(line) for line in text.split('\n')]


def hex_lines(value: bytes) -> Iterator[str]:
    """Write bytes as offset, hex digits and what of them is ASCII."""
    for begin in range(0, len(value), _ROW_BYTES):
        row = value[begin : begin + _ROW_BYTES]
        visible = ''.join(chr(byte) if 0x20 <= byte < 0x7F else '.' for byte in row)
        yield f'{begin:08x}  {row.hex(" "):{3 * _ROW_BYTES - 1}}  {visible}'
