""".msg text of a type: what `ros.message_path` reads, and what other tools show of a recording.

The defaults of a type that a node describes are the text of a stranger: nothing in them may end
the line that they stand on.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import document, load_layout
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.message_types.layout import (
    Constant,
    Field,
    Layout,
    Scalar,
    layouts_in,
    ros_type,
    with_layout,
)

_BETWEEN: Final = '=' * 80
# The parser of ROS 2 takes one for a comment and the other for a constant, in quotes, too.
_MARKS: Final = '#='


def msg_files(layout: Layout) -> dict[str, str]:
    """The .msg text of a type and of each type that it holds, by name; its own is the first.

    Args:
        layout: Documented, or its constants and comments are left out.

    Raises:
        ConfigError: .msg cannot say all of it.
    """
    layouts = layouts_in(layout)
    for name in layouts:
        if has_key(name):
            raise _refused(name, 'fields of it are a DDS key: install its package')
    texts = {name: _text(one) for name, one in layouts.items()}
    _check(layout, texts)
    return texts


def msg_text(layout: Layout) -> str:
    """All texts of `msg_files` in one, as recordings hold them.

    Raises:
        ConfigError: .msg cannot say all of it.
    """
    own, *others = msg_files(layout).items()
    held = [f'{_BETWEEN}\nMSG: {_short(name)}\n{text}' for name, text in others]
    return ''.join([own[1], *held])


def _refused(name: str, why: str) -> ConfigError:
    return ConfigError([f'{name} cannot be written as .msg: {why}'])


def _short(name: str) -> str:
    return name.replace('/msg/', '/')


# Text


def _text(layout: Layout) -> str:
    lines = [*_comment(layout.doc)]
    groups: list[tuple[Constant | Field, ...]] = [layout.constants, layout.fields]
    for group in groups:
        for number, one in enumerate(group):
            # Comments at the beginning are of the type, up to an empty line.
            if one.doc or not number:
                lines += [''] * bool(lines or one.doc)
            lines += _comment(one.doc)
            lines.append(_line(one, layout.type_name))
    return ''.join(f'{line}\n' for line in lines)


def _comment(doc: str) -> Iterator[str]:
    return (f'# {line}'.rstrip() for line in doc.splitlines())


def _line(one: Constant | Field, type_name: str) -> str:
    head = f'{_short(ros_type(one.kind))} {one.name}'
    try:
        if isinstance(one, Constant):
            return f'{head}={_value(one.value)}'
        return head if one.default is None else f'{head} {_value(one.default)}'
    except ValueError as error:
        raise _refused(type_name, f'{one.name}: {error}') from error


def _value(value: Scalar | tuple[Scalar, ...]) -> str:
    match value:
        case tuple():
            texts = [_listed(one) if isinstance(one, str) else _value(one) for one in value]
            return f'[{", ".join(texts)}]'
        case bool():
            return str(value).lower()
        case str():
            return f'"{"".join(map(_escaped, value))}"'
        case _:
            return repr(value)


def _escaped(char: str) -> str:
    """A character of a text, where escapes are of the bytes of UTF-8."""
    if char.isprintable() and char not in f'{_MARKS}"\\':
        return char
    return ''.join(f'\\x{byte:02x}' for byte in char.encode(errors='surrogatepass'))


def _listed(text: str) -> str:
    """A text in a list, where there are no escapes."""
    if not text.isprintable() or {*_MARKS} & {*text} or text != text.strip():
        raise ValueError(f'{text!r:.60} cannot stand in a list')
    quote = '"' if '"' not in text else "'"
    return f'{quote}{text}{quote}'


# Check


def _check(layout: Layout, texts: dict[str, str]) -> None:
    """Read the files as a bridge would: they say all of the type, and nothing else."""
    name = layout.type_name
    try:
        with tempfile.TemporaryDirectory() as folder:
            read = _read(name, texts, Path(folder))
    except OSError as error:
        raise _refused(name, f'a temporary folder is needed: {error.strerror}') from error
    # Not compared by their values: a default may be NaN.
    if repr(_defined(read)) != repr(_defined(layout)):
        raise _refused(name, 'it would be read as another definition')
    if layout.type_hash not in {None, read.type_hash}:
        raise _refused(
            name, f'its hash is {layout.type_hash}, that of its fields is {read.type_hash}'
        )


def _read(name: str, texts: dict[str, str], folder: Path) -> Layout:
    for one, text in texts.items():
        file = folder / f'{one}.msg'
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8', newline='', errors='surrogatepass')
    try:
        return document(load_layout(name, [folder]), [folder])
    except ConfigError as error:
        words = ' '.join(str(error).replace(f'{folder}/', '').split())
        raise _refused(name, words) from error


def _defined(layout: Layout) -> Layout:
    """A layout without what is for people."""
    return replace(
        layout,
        fields=tuple(
            field._replace(kind=with_layout(field.kind, _defined), doc='')
            for field in layout.fields
        ),
        constants=tuple(constant._replace(doc='') for constant in layout.constants),
        doc='',
        type_hash=None,
    )
