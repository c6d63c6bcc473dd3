"""The pages and what they are made of: files of this package, and nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable

from fastapi import Response
from fastapi.responses import HTMLResponse, PlainTextResponse

_TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="/static/icon.svg">
{parts}
</head>
<body>
<div id="banner" class="banner" role="alert" hidden></div>
{body}</body>
</html>
"""


def page(name: str, title: str, scripts: Sequence[str]) -> Response:
    """The page whose body is `name`.html, with the common styles, its own, the common script and `scripts`."""
    parts = [f'<link rel="stylesheet" href="/static/{style}.css">' for style in ("common", name)]
    parts += [f'<script src="/static/{script}.js" defer></script>' for script in ("common", *scripts)]
    body = _resource(f"{name}.html").read_text(encoding="utf-8")
    return HTMLResponse(_PAGE.format(title=escape(title), parts="\n".join(parts), body=body), headers=_HEADERS)


def static_file(name: str) -> Response:
    """A style, script or picture, by its bare name."""
    suffix = name[name.rfind(".") :]
    if "/" in name or suffix not in _TYPES or not _resource(name).is_file():
        return plain_text("There is no such page.\n", 404)
    return Response(_resource(name).read_bytes(), media_type=_TYPES[suffix], headers=_HEADERS)


def plain_text(text: str, status: int = 200) -> Response:
    """A line of text."""
    return PlainTextResponse(text, status_code=status, headers=_HEADERS)


def _resource(name: str) -> Traversable:
    return files("tactuator.web").joinpath("static", name)
