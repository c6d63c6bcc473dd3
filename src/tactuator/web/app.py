"""The server of a study: its pages, the two kinds of connection, and the checks of who may open which."""

from __future__ import annotations

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException as StarletteHTTPException

from tactuator.web.lab import Lab
from tactuator.web.pages import plain_text, static_file
from tactuator.web.study_pages import StudyPages, add_study_pages


def build_app(lab: Lab, operator_token: str) -> FastAPI:
    """Return the web application of one lab."""
    app = FastAPI(title="tactuator", docs_url=None, redoc_url=None, openapi_url=None)
    add_study_pages(app, StudyPages(lab), operator_token)

    @app.get("/")
    async def index() -> Response:
        return plain_text(lab.words("page.nothing_here"))

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or plain_text(lab.words("page.no_page"), 404)

    @app.exception_handler(StarletteHTTPException)
    async def told(request: Request, error: StarletteHTTPException) -> Response:
        return plain_text(lab.words("page.no_page"), error.status_code)

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        return plain_text(lab.words("page.no_page"), 500)

    @app.exception_handler(RequestValidationError)
    async def refused(request: Request, error: RequestValidationError) -> Response:
        return plain_text(lab.words("page.no_page"), 422)

    return app
