"""A page and its files: those of its own, and those that all pages share."""

from pathlib import Path
from typing import Final

from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

SHARED: Final = Path(__file__).parent / 'static'
_LEAST_BYTES: Final = 500  # that are worth being compressed


def file_routes(own: Path) -> list[BaseRoute]:
    """Where a browser finds them.

    Args:
        own: The folder of the page; its `index.html` is the page itself.
    """

    async def index(_request: Request) -> Response:
        return FileResponse(own / 'index.html')

    return [
        Route('/', index),
        Mount('/static/shared', GZipMiddleware(StaticFiles(directory=SHARED), _LEAST_BYTES)),
        Mount('/static', GZipMiddleware(StaticFiles(directory=own), _LEAST_BYTES)),
    ]
