"""How much code there is: lines without blanks, comments and docstrings, and the largest classes.

python tools/code_lines.py [FOLDER]
"""

import ast
import io
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

_NO_CODE = {
    tokenize.COMMENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
    tokenize.INDENT,
    tokenize.NEWLINE,
    tokenize.NL,
}
_LARGE = 12
_HOME = Path(__file__).parents[1] / 'src' / 'ros2_kafka_bridge'


def code_lines(text: str) -> int:
    """How many lines of a module hold code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            lines |= {*range(token.start[0], token.end[0] + 1)}
    return len(lines - set(_docstring_lines(ast.parse(text))))


def _docstring_lines(tree: ast.Module) -> Iterator[int]:
    """The lines of strings that stand alone: docstrings, also those behind a name."""
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                yield from range(node.lineno, (node.end_lineno or node.lineno) + 1)


def attributes(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """How many attributes each class sets on `self`, with its name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            stored = {
                it.attr
                for it in ast.walk(node)
                if isinstance(it, ast.Attribute) and isinstance(it.ctx, ast.Store)
                if isinstance(it.value, ast.Name) and it.value.id == 'self'
            }
            yield len(stored), node.name


def main(folder: Path) -> None:
    """Print the sum, and the classes that hold most."""
    texts = {file: file.read_text('utf-8') for file in sorted(folder.rglob('*.py'))}
    print(f'{sum(map(code_lines, texts.values())):,} lines of code in {len(texts)} files')
    found = [
        (count, name, file.relative_to(folder))
        for file, text in texts.items()
        for count, name in attributes(ast.parse(text))
        if count > _LARGE
    ]
    for count, name, file in sorted(found, reverse=True):
        print(f'{count:4} attributes  {name}  {file}')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else _HOME)
