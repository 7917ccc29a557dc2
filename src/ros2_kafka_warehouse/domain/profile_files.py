"""What both profiles share when they are read: messages in YAML, and all mistakes at once."""

from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from ros2_kafka_warehouse.domain.yaml_file import FileError, YamlFile, read_yaml
from ros2_kafka_warehouse.messages.message import Message

M = TypeVar('M', bound=Message)


class ProfileError(ValueError):
    """A profile cannot be used; `problems` holds every mistake found, one line each."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__('\n'.join(problems))
        self.problems = problems


def near_miss(name: str, names: list[str]) -> str:
    """Which of the names was meant, as the end of a sentence, or which there are."""
    close = get_close_matches(name, names, n=1)
    return f'did you mean {close[0]}?' if close else f'there are {", ".join(names)}'


class ProfileFile:
    """A YAML file whose fields are spelled as in the messages that it holds (`max_load_kg`).

    Raises:
        ProfileError: It cannot be read, or is not YAML.
    """

    def __init__(self, path: Path, sections: tuple[str, ...]) -> None:
        try:
            self._file: YamlFile = read_yaml(path)
        except FileError as error:
            raise ProfileError([str(error)]) from error
        self.problems: list[str] = []
        if not isinstance(self._file.data, dict):
            self.wrong(f'must have the fields {", ".join(sections)}')
            return
        for name in self._file.data:
            if name not in sections:
                self.wrong(f'no such field; {near_miss(str(name), list(sections))}', str(name))

    def names(self, section: str) -> tuple[str, ...]:
        """The names in a section that is a mapping."""
        try:
            return self._file.names(section) if isinstance(self._file.data, dict) else ()
        except FileError as error:
            self.problems.append(str(error))
            return ()

    def count(self, section: str) -> int:
        """How many items a section has that is a list."""
        items = self._file.data.get(section) if isinstance(self._file.data, dict) else None
        if items is not None and not isinstance(items, list):
            self.wrong("must be a list of rows, each with a '-'", section)
        return len(items) if isinstance(items, list) else 0

    def message(self, kind: type[M], *place: str | int, **given: Any) -> M | None:
        """The message at a place; `given` are fields which the file does not hold itself.

        Returns:
            None after a mistake, which is in `problems`.
        """
        known = len(self.problems)
        values = self._value(kind, place, frozenset(given))
        for field in msgspec.structs.fields(kind):
            if _is_message(field.type) and field.name in values:
                values[field.name] = self.message(field.type, *place, field.name)
            elif field.required and field.name not in values and field.name not in given:
                self.wrong(f"the field '{field.name}' is missing", *place)
        return None if len(self.problems) > known else kind(**values, **given)

    def wrong(self, text: str, *place: str | int) -> None:
        """Note a mistake at a place."""
        self.problems.append(str(self._file.error(text, *place)))

    def check(self) -> None:
        """End the reading.

        Raises:
            ProfileError: There were mistakes.
        """
        if self.problems:
            raise ProfileError(self.problems)

    def _value(
        self, kind: type[Message], place: tuple[str | int, ...], given: frozenset[str]
    ) -> dict[str, Any]:
        if self._file.value(Any, *place) is None:  # a name with nothing after it: all defaults
            return {}
        try:
            read = self._file.value(_strict(kind, given), *place)
        except FileError as error:
            self.problems.append(str(error))
            return {}
        values = msgspec.structs.asdict(read)
        return {name: value for name, value in values.items() if value is not msgspec.UNSET}


def _is_message(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Message)


@cache
def _strict(kind: type[Message], without: frozenset[str]) -> type[msgspec.Struct]:
    """The same fields under their own names, none of them required, and no others."""
    fields = [
        (
            field.name,
            (dict[str, Any] if _is_message(field.type) else field.type) | msgspec.UnsetType,
            msgspec.UNSET,
        )
        for field in msgspec.structs.fields(kind)
        if field.name not in without
    ]
    return msgspec.defstruct(kind.__name__, fields, forbid_unknown_fields=True)
