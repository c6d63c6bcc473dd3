"""Routes by which the page drops files on the server, and takes up those that a view made."""

from __future__ import annotations

import hmac
from urllib.parse import unquote

from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, JSONResponse
from starlette.requests import ClientDisconnect

from tactuator.console.drawer import Drawer
from tactuator.errors import BadInput
from tactuator.web.pages import HEADERS, holds_file, plain_text

_NOTHING = "There is no such file here."


def add_file_routes(app: FastAPI, drawer: Drawer, token: str) -> None:
    """Add the routes of the drawer to the console's application; each request bears the token in a header."""

    def allowed(request: Request) -> bool:
        return hmac.compare_digest(request.headers.get("x-token", "").encode(), token.encode())

    @app.post("/drop")
    async def drop(request: Request) -> Response:
        if not allowed(request):
            return plain_text("That needs the token of the page.", 403)
        try:
            key = await drawer.take(unquote(request.headers.get("x-name", "")), request.stream())
        except BadInput as error:
            return plain_text(str(error), 422)
        except ClientDisconnect:
            return plain_text("The sender went before the file was whole.", 400)
        return JSONResponse({"key": key, "name": drawer.path(key).name}, headers=HEADERS)

    @app.get("/made/{key}/{name}")
    async def made(request: Request, key: str, name: str) -> Response:
        if not allowed(request):
            return plain_text("That needs the token of the page.", 403)
        try:
            folder = drawer.path(key).parent
        except BadInput as error:
            return plain_text(str(error), 404)
        if not holds_file(folder, name):
            return plain_text(_NOTHING, 404)
        return FileResponse(folder / name, headers=HEADERS)
