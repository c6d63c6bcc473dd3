"""The pages and their parts: files of this package, and nothing from elsewhere."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, PlainTextResponse
from starlette.exceptions import HTTPException as StarletteHTTPException

from tactuator.experiment.words import Words

_TYPES = {
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".html": "text/html",
    ".md": "text/plain",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
_PAGE = """<!doctype html>
<html lang="{language}" dir="{direction}">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="/static/icon.svg">
{parts}
</head>
<body>
<script type="application/json" id="words">{words}</script>
<div id="banner" class="banner" role="alert" hidden></div>
{body}</body>
</html>
"""
_TABLES = {"subject": "page", "operator": "operator"}
"""Table of the language file from which each page takes its texts."""


def page(name: str, words: Words, scripts: Sequence[str]) -> Response:
    """Return the page whose body is `name`.html, with the common styles, its own, the common script and `scripts`.

    {{key}} in the body is the text of that key; the page's whole table of texts goes along for its scripts.
    """
    table = f"{_TABLES[name]}."
    texts = {key.removeprefix(table): text for key, text in words.texts.items() if key.startswith(table)}
    parts = [f'<link rel="stylesheet" href="/static/{style}.css">' for style in ("common", name)]
    parts += [f'<script src="/static/{script}.js" defer></script>' for script in ("common", *scripts)]
    body = _static().joinpath(f"{name}.html").read_text("utf-8")
    body = re.sub(r"\{\{([a-z_.]+)\}\}", lambda key: escape(words(key[1])), body)
    return HTMLResponse(
        _PAGE.format(
            language=escape(words.language),
            direction=words.direction,
            title=escape(words(f"{table}title")),
            parts="\n".join(parts),
            words=json.dumps(texts, ensure_ascii=False).replace("<", "\\u003c"),
            body=body,
        ),
        headers=HEADERS,
    )


def static_file(name: str) -> Response | None:
    """Return a style, script or picture by its bare name, or None."""
    return None if name.endswith(".html") else file_response(_static(), name, HEADERS)


def file_response(folder: Traversable, name: str, headers: Mapping[str, str]) -> Response | None:
    """Return a file of a folder by its bare name, or None without one of a kind that pages have."""
    suffix = name[name.rfind(".") :]
    if suffix not in _TYPES or not holds_file(folder, name):
        return None
    return Response(folder.joinpath(name).read_bytes(), media_type=_TYPES[suffix], headers=headers)


def holds_file(folder: Traversable, name: str) -> bool:
    """Return whether the folder lists a file of that name: a request's own, which the system may refuse (too long)."""
    return any(file.name == name and file.is_file() for file in folder.iterdir())


def plain_text(text: str, status: int = 200) -> Response:
    """Return a page of one line of text."""
    return PlainTextResponse(f"{text}\n", status_code=status, headers=HEADERS)


def answer_plainly(app: FastAPI, text: Callable[[], str]) -> None:
    """Let an application answer what it has no page for, and what fails, with a line of text."""

    async def plainly(request: Request, error: Exception) -> Response:
        invalid = 422 if isinstance(error, RequestValidationError) else 500
        return plain_text(text(), error.status_code if isinstance(error, StarletteHTTPException) else invalid)

    for kind in (StarletteHTTPException, RequestValidationError, Exception):
        app.add_exception_handler(kind, plainly)


def _static() -> Traversable:
    return files("tactuator.web").joinpath("static")
