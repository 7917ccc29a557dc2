"""A configuration for the names and brokers of a test."""

import re
from pathlib import Path


def renamed(file: Path, *names: tuple[str, str]) -> Path:
    """The file with other names in its values."""
    text = file.read_text()
    for old, new in names:
        assert re.search(rf'(?<=: ){re.escape(old)}(?=[,}}\n])', text), old
        text = re.sub(rf'(?<=: ){re.escape(old)}(?=[,}}\n])', new, text)
    file.write_text(text)
    return file
