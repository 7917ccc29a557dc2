"""The live page of a bridge in a real browser, also with a view that is made up."""

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import msgspec
from playwright.sync_api import Browser, Page, Route, expect, sync_playwright

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.validation import plain
from ros2_kafka_bridge.monitoring import view
from ros2_kafka_bridge.monitoring.history import BUCKET_S, SPAN_S
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.monitoring.web import STATIC
from ros2_kafka_bridge.protocol.monitor import Configured, Report
from ros2_kafka_bridge.web.files import SHARED

CHROMIUM: Final = shutil.which('chromium')
PATIENCE_MS: Final = 90_000
NOWHERE: Final = 'http://bridge.invalid/'


@contextmanager
def chromium(patience_ms: int = PATIENCE_MS) -> Iterator[Browser]:
    """A browser that waits patiently for what is expected of it."""
    expect.set_options(timeout=patience_ms)
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=['--no-sandbox'])
        yield found
        found.close()


@contextmanager
def opened(browser: Browser, url: str, **options: Any) -> Iterator[Page]:
    """A page in a session of its own; nothing goes wrong in its console."""
    with _session(browser, options) as page:
        page.goto(url)
        yield page


@contextmanager
def _session(browser: Browser, options: dict[str, Any]) -> Iterator[Page]:
    options.setdefault('viewport', {'width': 1440, 'height': 900})
    context = browser.new_context(**options)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    said: list[str] = []
    page.on('pageerror', lambda error: said.append(str(error)))
    page.on('console', lambda it: said.append(it.text) if it.type == 'error' else None)
    yield page
    context.close()
    # A browser tells each refused request as an error; here some are meant to be.
    assert [it for it in said if 'status of 40' not in it] == []


class MadeUp:
    """What a bridge would tell its page.

    Args:
        config: Of the bridge.
        told: Its last report, and those before it.
        beside: What the page is told of Kafka, of ROS (`graph`) and of the last minutes.
    """

    def __init__(self, config: str, *told: Report, **beside: Any) -> None:
        watch = Watch(lambda _: None)
        for it in (Configured(plain(loads(config, 'bridge.yaml', {})), 'bridge.yaml'), *told):
            watch.on_line(msgspec.json.encode(it) + b'\n')
        sparks = {'step_s': BUCKET_S, 'span_s': SPAN_S, 'routes': view.sparks(watch)}
        graph = {'problem': '', 'seen_s': int(time.time()), 'topics': []}
        beyond: dict[str, Any] = {'broker': None, 'letters': [], 'replay': None}
        sections = msgspec.to_builtins(view.sections(watch)) | beyond
        shown = {name: beside.get(name, content) for name, content in sections.items()}
        # Where the stream ends the page asks again: it is told the same, and no other page is.
        self._answers = {
            'api/events': f'retry: 600000\ndata: {json.dumps(shown)}\n\n',
            'api/history': json.dumps(sparks),
            'api/graph': json.dumps(beside.get('graph', graph)),
        }

    def answer(self, route: Route) -> None:
        """Be the server."""
        path = route.request.url.removeprefix(NOWHERE).partition('#')[0]
        if path in self._answers:
            kind = 'text/event-stream' if path == 'api/events' else 'application/json'
            route.fulfill(body=self._answers[path], content_type=kind)
        else:
            shared, name = path.partition('static/shared/')[2], path.removeprefix('static/')
            route.fulfill(path=SHARED / shared if shared else STATIC / (name or 'index.html'))


@contextmanager
def shown(browser: Browser, told: MadeUp, view: str = 'routes', **options: Any) -> Iterator[Page]:
    """The page, with what a bridge tells that is made up."""
    with _session(browser, options) as page:
        page.route(f'{NOWHERE}**', told.answer)
        page.goto(f'{NOWHERE}#{view}')
        yield page
