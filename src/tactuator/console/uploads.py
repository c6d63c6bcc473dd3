"""Files that were dropped on the page: kept in a folder of the server's own, gone when it ends; and their routes."""

from __future__ import annotations

import hmac
import re
import secrets
import shutil
import tempfile
import weakref
from collections import OrderedDict
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, JSONResponse
from starlette.requests import ClientDisconnect

from tactuator.errors import BadInput, TactuatorError
from tactuator.io.shipped import EXAMPLES, example_names
from tactuator.web.pages import HEADERS, holds_file, plain_text

BYTES_MAX = 512 * 1024 * 1024
"""Length of the longest file that is taken."""
EXAMPLE = "example:"
"""What the key of a file of the package begins with."""
_MOST_FILES, _LONGEST_NAME = 24, 120
_NO_FILE = "There is no such file here."


class UploadedFiles:
    """Files by key. A file keeps its name, which results mention; of many files the oldest are forgotten."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._files: OrderedDict[str, Path] = OrderedDict()

    async def take(self, name: str, blocks: AsyncIterator[bytes]) -> str:
        """Keep a file and return its key. Raises BadInput for a name that is none, or a file that is too long."""
        plain = name.replace("\\", "/").rpartition("/")[2].strip()
        if not plain or plain.startswith(".") or len(plain) > _LONGEST_NAME or not plain.isprintable():
            raise BadInput(f"a file named {name[:60]!r}", f"a name of 1 to {_LONGEST_NAME} characters")
        key, folder = self.new_folder()
        try:
            await _written(folder / plain, blocks)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise BadInput(f"{plain} cannot be kept: {error.strerror or error}", "one that fits") from None
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self.keep(key, folder / plain)
        return key

    def path(self, key: str) -> Path:
        """Return the file of a key, or an example's. Raises BadInput for one that is not there (any more)."""
        name = key.removeprefix(EXAMPLE)
        if key != name and name in example_names():
            return EXAMPLES / name
        if key not in self._files:
            raise BadInput("that file is not on the server any more: drop it again")
        return self._files[key]

    def new_folder(self) -> tuple[str, Path]:
        """Return a new key and its folder, for files that a view makes; the first of them is kept by `keep`."""
        key = secrets.token_hex(8)
        place = self.folder() / key
        place.mkdir()
        return key, place

    def keep(self, key: str, path: Path) -> None:
        """Keep a file by its key; of many files the oldest are forgotten."""
        self._files[key] = path
        while len(self._files) > _MOST_FILES:
            shutil.rmtree(self._files.popitem(last=False)[1].parent, ignore_errors=True)

    def folder(self) -> Path:
        """Return the folder of the uploads, made the first time it is asked for."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="tactuator-console-"))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        return self._folder

    def forget(self) -> None:
        """Remove the folder with all that it holds, as the end of the program does."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    @contextmanager
    def named_plainly(self) -> Iterator[None]:
        """Name the file in refusals by its own name: the folder on the server means nothing to the reader."""
        try:
            yield
        except TactuatorError as error:
            error.where = tuple(self.plain(part) for part in error.where)
            error.got, error.allowed = self.plain(error.got), self.plain(error.allowed)
            raise

    def plain(self, words: str) -> str:
        """Return words without the folder of an uploaded file that they name."""
        return re.sub(re.escape(f"{self._folder}/") + "[0-9a-f]{16}/", "", words)


async def _written(path: Path, blocks: AsyncIterator[bytes]) -> None:
    length = 0
    with path.open("wb") as file:
        async for block in blocks:
            length += len(block)
            if length > BYTES_MAX:
                raise BadInput(f"{path.name} has more than {BYTES_MAX // 2**20} MB", "a shorter file")
            file.write(block)


def bears_token(request: Request, token: str) -> bool:
    """Return whether a request that is no connection bears the page's token."""
    return hmac.compare_digest(request.headers.get("x-token", "").encode(), token.encode())


def add_file_routes(app: FastAPI, uploads: UploadedFiles, token: str) -> None:
    """Add the routes of the uploads to the console's application; each request bears the token in a header."""

    @app.post("/drop")
    async def drop(request: Request) -> Response:
        if not bears_token(request, token):
            return plain_text("That needs the token of the page.", 403)
        try:
            key = await uploads.take(unquote(request.headers.get("x-name", "")), request.stream())
        except BadInput as error:
            return plain_text(str(error), 422)
        except ClientDisconnect:
            return plain_text("The sender went before the file was whole.", 400)
        return JSONResponse({"key": key, "name": uploads.path(key).name}, headers=HEADERS)

    @app.get("/made/{key}/{name}")
    async def made(request: Request, key: str, name: str) -> Response:
        if not bears_token(request, token):
            return plain_text("That needs the token of the page.", 403)
        try:
            folder = uploads.path(key).parent
        except BadInput as error:
            return plain_text(str(error), 404)
        if not holds_file(folder, name):
            return plain_text(_NO_FILE, 404)
        return FileResponse(folder / name, headers=HEADERS)
