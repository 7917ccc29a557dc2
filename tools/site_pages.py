"""A hook of MkDocs: pages beside `docs`, links that leave it, what the search shows first."""

import posixpath
import re
from pathlib import Path
from typing import Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[1]
BESIDE: Final = {
    'README.md': 'index.md',
    'CHANGELOG.md': 'changelog.md',
    'CONTRIBUTING.md': 'contributing.md',
    'SECURITY.md': 'security-policy.md',
}
"""The pages beside `docs`, as a forge wants them, and what they are called on the site."""

_BOOST: Final = {
    'configuration.md': 2.0,
    'troubleshooting.md': 2.0,
    'changelog.md': 0.2,
    'contributing.md': 0.2,
    'test-record.md': 0.2,
}
"""What the search shows first, and last: who looks for a setting needs no history."""

_FENCED: Final = re.compile(r'(^```.*?^```$)', re.DOTALL | re.MULTILINE)
_LINK: Final = re.compile(r'\]\((?!\w+:)([^)#\s]+)')


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages beside `docs`."""
    for name, page in BESIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead each link to the page of the site, or else to the file in the repository."""
    if boost := _BOOST.get(page.file.src_uri):
        page.meta['search'] = {'boost': boost}
    pages = {file.abs_src_path: file.src_uri for file in files if file.abs_src_path}
    folder = Path(page.file.abs_src_path or ROOT).parent
    here = posixpath.dirname(page.file.src_uri)

    def led(link: re.Match[str]) -> str:
        target = (folder / link[1]).resolve()
        if uri := pages.get(str(target)):
            return f']({posixpath.relpath(uri, here)}'
        kind = 'tree' if target.is_dir() else 'blob'
        return f']({config.repo_url}/{kind}/main/{target.relative_to(ROOT)}'

    parts = _FENCED.split(markdown)
    return ''.join(part if part.startswith('```') else _LINK.sub(led, part) for part in parts)
