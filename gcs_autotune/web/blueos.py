"""What BlueOS asks a service for: who it is (``/register_service``), and what it offers Cockpit.

The page's addresses are relative, so BlueOS may show it under ``/extensionv2/...``. STOP is on the page and its space
bar; as an action of Cockpit's own (a joystick button) it is not offered: that page would have to hold the token.
"""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from gcs_autotune import __version__

__all__ = ["blueos_routes", "cockpit_extras", "registration"]

_NAME = "GCS Autotune"
_HOME = "https://github.com/gcs-autotune/gcs-autotune"


def registration() -> dict[str, Any]:
    """Return what ``/register_service`` answers."""
    return {
        "name": _NAME,
        "description": "Identify and tune a boat or ROV from a short experiment, and prove the gains.",
        "icon": "mdi-tune-vertical-variant",
        "company": "gcs_autotune",
        "version": __version__,
        "webpage": _HOME,
        "api": f"{_HOME}/tree/main/docs",
        "new_page": False,
        "avoid_iframes": False,
        "works_in_relative_paths": True,
        "extras": {"cockpit": "/cockpit_extras.json"},
    }


def cockpit_extras() -> dict[str, Any]:
    """Return what Cockpit may show: the page as a widget. Keys as Cockpit 1.18 and later want them."""
    return {
        "targetSystem": "Cockpit",
        "targetCockpitApiVersion": "1.0.0",
        "widgets": [
            {
                "name": _NAME,
                "iframeUrl": "/",
                "iframeIcon": "/static/icon.svg",
                "version": __version__,
                "useExtensionPathAsBaseUrl": True,
            }
        ],
        "actions": [],
    }


def blueos_routes() -> list[BaseRoute]:
    """Return the routes."""

    async def register(request: Request) -> Response:
        return JSONResponse(registration())

    async def extras(request: Request) -> Response:
        return JSONResponse(cockpit_extras())

    return [Route("/register_service", register), Route("/cockpit_extras.json", extras)]
